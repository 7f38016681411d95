"""What a robot remembers on disk of the arm that it is in."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest

from jouleswarm.agents.memory import Memory
from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.disk.state import Keep, State
from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario

ARMS = ("maml", "fl", "fedavg")
START = {"w": np.arange(3, dtype=np.float32)}


class Count:
    """Something with a state."""

    def __init__(self, count: int = 0) -> None:
        self.count = count

    def state(self) -> State:
        return State({"n": np.array(self.count)}, {"n": self.count})

    def load_state(self, state: State) -> None:
        assert state.arrays["n"] == state.values["n"]
        self.count = state.values["n"]


def scenario(**sections: object) -> Scenario:
    data = {"name": "t", "methods": list(ARMS), "tasks": [{"id": 1, "map": "E . \n * . \n X ."}]}
    return scenario_from({**data, "world": {"rows": 3, "cols": 2}, "meta": {"training_tasks": [1]}, **sections}, "test")


def memory(folder: Path | None, agent: int = 1, run: str = "r", **sections: object) -> Memory:
    return Memory(scenario(**sections), agent, run, Keep(folder), Meter("client"))


@pytest.mark.parametrize("folder", [True, False], ids=["an empty folder", "no folder"])
def test_at_first_nothing_is_remembered(folder: bool, tmp_path: Path) -> None:
    new = memory(tmp_path / "robot" if folder else None)
    assert [new.is_past(arm, ARMS) for arm in ARMS] == [False] * 3
    assert [new.start_of(arm) for arm in ARMS] == [None] * 3
    assert not any(new.has_ended(arm) for arm in ARMS)
    assert new.restore("maml", {"count": Count()}) == 0


def test_without_a_folder_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    new = memory(None)
    new.begin("maml", START)
    new.save("maml", 1, {"count": Count()})
    new.clear()
    assert (new.rows, new.frames("fl")) == (None, None)
    assert list(tmp_path.iterdir()) == []


def test_an_arm_that_was_begun_is_begun_again_with_the_same_weights(tmp_path: Path) -> None:
    memory(tmp_path).begin("fl", START)
    back, count = memory(tmp_path), Count(7)
    assert [back.is_past(arm, ARMS) for arm in ARMS] == [True, False, False]
    start = back.start_of("fl")
    assert start is not None
    assert start["w"].tobytes() == START["w"].tobytes()
    assert [back.start_of(arm) for arm in ("maml", "fedavg")] == [None, None]
    assert (back.restore("fl", {"count": count}), count.count) == (0, 7)


def test_the_last_whole_round_is_where_a_robot_goes_on(tmp_path: Path) -> None:
    first = memory(tmp_path)
    first.begin("fl", START)
    for round_ in (1, 2):
        first.save("fl", round_, {"one": Count(10 * round_), "other": Count(round_)})
    back, one, other = memory(tmp_path), Count(), Count()
    assert back.restore("fedavg", {"one": one}) == 0
    assert back.restore("fl", {"one": one, "other": other}) == 2
    assert (one.count, other.count) == (20, 2)
    assert back.start_of("fl") is not None  # the arm has been begun
    assert not back.has_ended("fl")


def test_an_arm_that_has_ended_is_not_learned_again(tmp_path: Path) -> None:
    first = memory(tmp_path)
    first.begin("fl", START)
    first.save("fl", 3, {"exchange": Count(3)}, ended=True)
    back = memory(tmp_path)
    assert [back.has_ended(arm) for arm in ARMS] == [False, True, False]
    assert [back.is_past(arm, ARMS) for arm in ARMS] == [True, False, False]


OTHERS = {
    "another robot": {"agent": 2},
    "another run": {"run": "other"},
    "another seed": {"seed": 9},
    "another window": {"federation": {"reward_window": 7}},
}


@pytest.mark.parametrize("other", OTHERS)
def test_another_robots_runs_or_scenarios_memory_is_refused(other: str, tmp_path: Path) -> None:
    memory(tmp_path).begin("fl", START)
    with pytest.raises(RunError, match="name another folder with --state"):
        memory(tmp_path, **OTHERS[other])  # type: ignore[arg-type]


def test_what_changes_nothing_that_is_learned_may_change(tmp_path: Path) -> None:
    memory(tmp_path).begin("fl", START)
    back = memory(tmp_path, name="renamed", bus={"resend_after_s": 3}, energy={"pue": 1.5})
    assert back.start_of("fl") is not None


def test_rows_and_counters_beside_a_state_are_found_as_they_were_or_it_is_refused(tmp_path: Path) -> None:
    meter = Meter("client", tmp_path)
    meter.count("agent-1", "jouleswarm/r/fl/sl/1/1/weights", "out", 10, 20)
    first = memory(tmp_path)
    assert first.rows is not None
    first.rows.write_text('{"phase":"fl","round":1}\n')
    first.save("fl", 1, {"one": Count(1)})
    with first.rows.open("a") as rows:
        rows.write('{"phase":"fl","round":2}\n')  # of a round that was not saved any more
    assert memory(tmp_path).restore("fl", {"one": Count()}) == 1
    for name in ("rounds.jsonl", "counters.keys"):
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(b"?" + whole[1:])
        with pytest.raises(RunError, match=f"^{tmp_path}/{name}: not as it was written"):
            memory(tmp_path)
        (tmp_path / name).write_bytes(whole)


def test_a_state_that_has_gone_is_missed_where_rows_tell_of_it(tmp_path: Path) -> None:
    (tmp_path / "rounds.jsonl").write_text('{"phase":"maml","round":1}\n')
    memory(tmp_path)  # of meta-learning there is no state
    (tmp_path / "rounds.jsonl").write_text('{"phase":"fl","round":1}\n')
    with pytest.raises(RunError, match=f"^{tmp_path}: the state is gone"):
        memory(tmp_path)


def test_a_robot_that_has_left_leaves_no_trace(tmp_path: Path) -> None:
    first = memory(tmp_path / "robot")
    assert first.rows is not None
    first.begin("fl", START)
    first.rows.write_text("row\n")
    lock = Lock(tmp_path / "robot", "robot 1")
    first.clear()
    assert list(tmp_path.iterdir()) == []
    lock.release()


def test_a_robot_that_has_left_leaves_somebody_elses_files_and_their_folder(tmp_path: Path) -> None:
    (tmp_path / "notes").mkdir()
    (tmp_path / "state.txt").write_text("mine")
    first = memory(tmp_path)
    first.begin("fl", START)
    first.clear()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes", "state.txt"]


def test_a_folder_that_cannot_be_removed_is_left_empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def mounted(path: Path) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(path))

    monkeypatch.setattr(Path, "rmdir", mounted)
    first = memory(tmp_path / "volume")
    first.begin("fl", START)
    first.clear()
    assert list((tmp_path / "volume").iterdir()) == []
