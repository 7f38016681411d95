"""The run directory."""

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.runs.directory import RunDirectory


def row(**fields: Any) -> RoundRow:
    return RoundRow.model_validate(
        {"phase": "fl", "arm": "maml", "task": 1, "agent": 1, "round": 1, "seconds": 0.5} | fields
    )


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_a_directory_that_is_not_empty_is_never_written_into(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    with pytest.raises(ConfigurationError, match="is not empty; name another"):
        RunDirectory(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["precious"]


def test_an_empty_or_new_directory_is_taken(tmp_path: Path) -> None:
    assert RunDirectory(tmp_path).path == tmp_path
    assert (RunDirectory(tmp_path / "a" / "b").path / "weights").is_dir()


def test_rows_are_on_disk_as_they_come(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    directory.round(row(agent=2, round=7))
    assert [each["round"] for each in lines(tmp_path / "rounds.jsonl")] == [7]
    directory.round(row(agent=1, round=6))
    assert [each["round"] for each in lines(tmp_path / "rounds.jsonl")] == [7, 6]
    assert [each.round for each in directory.rows] == [7, 6]


def test_the_finished_file_is_in_order_whatever_came_first(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    ordered = [
        row(arm="fl", task=1, agent=1, round=1),
        row(phase="maml", task=1, agent=0, round=1),
        row(phase="maml", task=1, agent=0, round=2),
        row(phase="maml", task=1, agent=1, round=1),
        row(task=1, agent=1, round=2),
        row(task=1, agent=1, round=10),
        row(task=2, agent=3, round=1),
    ]
    for each in (ordered[6], ordered[4], ordered[5], ordered[3], ordered[1], ordered[2], ordered[0]):
        directory.round(each)
    directory.summary({"seed": 1})
    assert [RoundRow.model_validate(each) for each in lines(tmp_path / "rounds.jsonl")] == ordered
    assert json.loads((tmp_path / "summary.json").read_text()) == {"seed": 1}


def test_meter_and_weights_are_written_whole(tmp_path: Path) -> None:
    directory, meter = RunDirectory(tmp_path), Meter("broker")
    meter.count("agent-1", "jouleswarm/r/maml/sl/1/1/weights", "in", 100, 140)
    directory.meter(meter.rows())
    directory.weights("maml-task1", memoryview(b"payload"))
    assert lines(tmp_path / "meter.jsonl") == [
        {
            "side": "broker", "arm": "maml", "phase": "fl", "topic": "jouleswarm/r/maml/sl/1/1/weights",
            "link": "sidelink", "client": "agent-1", "direction": "in",
            "messages": 1, "payload_bytes": 100, "packet_bytes": 140,
        }
    ]  # fmt: skip
    assert (tmp_path / "weights" / "maml-task1.safetensors").read_bytes() == b"payload"
    assert not list(tmp_path.rglob("*.part"))


def test_a_file_that_cannot_be_written_is_an_error_of_ours(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    (tmp_path / "weights").rmdir()
    with pytest.raises(RunError, match=r"cannot write .*No such file or directory"):
        directory.weights("maml-task1", b"payload")


def test_a_row_that_is_there_is_not_written_again(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    for seconds in (0.5, 0.7):
        directory.round(row(seconds=seconds))
    assert [each["seconds"] for each in lines(tmp_path / "rounds.jsonl")] == [0.5]


def test_rows_that_have_not_come_are_completed_by_the_list_of_all(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    ordered = [row(round=1), row(round=2), row(round=3), row(round=4)]
    for each in (ordered[0], ordered[2], ordered[1]):  # the last one comes late: it is left to the list
        directory.round(each)
    assert [each.round for each in directory.rows] == [1, 3]
    directory.complete(ordered)
    directory.complete(ordered)
    assert sorted(each.round for each in directory.rows) == [1, 2, 3, 4]


def test_an_interrupted_run_is_gone_on_with_and_its_torn_lines_are_cut_off(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    directory.manifest({"run": "r"})
    directory.round(row(round=1))
    directory.round(row(round=2), 1_700_000_000.1234)
    directory.progress({"time_s": 1.0})
    directory.weights("maml-task1", b"model")
    directory.meter([])
    directory.summary({"status": "interrupted"})
    for name in ("rounds.jsonl", "progress.jsonl", "times.jsonl"):
        with (tmp_path / name).open("a") as file:
            file.write('{"phase": "f')

    resumed = RunDirectory(tmp_path, resume=True)
    assert [each.round for each in resumed.rows] == [1, 2]
    assert not (tmp_path / "summary.json").exists()
    assert not (tmp_path / "meter.jsonl").exists()
    assert json.loads((tmp_path / "manifest.json").read_text()) == {"run": "r"}
    assert (tmp_path / "weights" / "maml-task1.safetensors").read_bytes() == b"model"
    resumed.round(row(round=2))
    resumed.round(row(round=3), 1_700_000_005.0)
    resumed.progress({"time_s": 2.0})
    assert [each["round"] for each in lines(tmp_path / "rounds.jsonl")] == [1, 2, 3]
    assert [each["time_s"] for each in lines(tmp_path / "progress.jsonl")] == [1.0, 2.0]
    whose = {key: getattr(row(round=2), key) for key in ("phase", "arm", "task", "agent")}
    assert lines(tmp_path / "times.jsonl") == [
        {"time_s": 1_700_000_000.123, **whose, "round": 2},
        {"time_s": 1_700_000_005.0, **whose, "round": 3},
    ]


def test_a_run_killed_before_its_first_row_is_gone_on_with(tmp_path: Path) -> None:
    RunDirectory(tmp_path).manifest({"run": "r"})
    resumed = RunDirectory(tmp_path, resume=True)
    assert resumed.rows == []
    resumed.round(row())
    assert len(lines(tmp_path / "rounds.jsonl")) == 1


@pytest.mark.parametrize("there", [True, False])
def test_what_is_no_run_is_not_gone_on_with(there: bool, tmp_path: Path) -> None:
    path = tmp_path if there else tmp_path / "nowhere"
    with pytest.raises(ConfigurationError, match=r"has no manifest\.json; name one that `jouleswarm run` printed"):
        RunDirectory(path, resume=True)
    assert list(tmp_path.iterdir()) == []


def test_a_figure_that_json_cannot_say_is_an_error_and_no_summary(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path / "r")
    with pytest.raises(
        RunError, match=r"summary\.json: a figure is not finite .*expected finite ones; rows and counters"
    ):
        directory.summary({"arms": {"fl": {"energy_j": math.inf}}})
    assert not (tmp_path / "r" / "summary.json").exists()


def test_a_lock_is_nothing_that_is_there(tmp_path: Path) -> None:
    with Lock(tmp_path, "jouleswarm run"):
        assert RunDirectory(tmp_path).path == tmp_path


def begun(path: Path, rounds: int = 3) -> RunDirectory:
    """A run of which a resume is told whether it is as it was."""
    directory = RunDirectory(path, state=path / "state" / "recorder")
    directory.manifest({"run": "r", "seed": 1})
    for round_ in range(1, rounds + 1):
        directory.round(row(round=round_))
    directory.weights("maml-task1", b"model")
    return directory


def resumed(path: Path) -> RunDirectory:
    return RunDirectory(path, resume=True, state=path / "state" / "recorder")


def test_a_run_that_is_as_it_was_is_gone_on_with_again_and_again(tmp_path: Path) -> None:
    begun(tmp_path)
    for number in (1, 2):
        directory = resumed(tmp_path)
        directory.manifest({"run": "r", "seed": 1, "resumed": [number]})
        directory.round(row(round=3 + number))
        directory.weights("maml-task1", b"model")
        directory.summary({"status": "interrupted"})
    assert [each.round for each in resumed(tmp_path).rows] == [1, 2, 3, 4, 5]


@pytest.mark.parametrize("name", ["manifest.json", "weights/maml-task1.safetensors"])
@pytest.mark.parametrize("damage", ["altered", "cut short", "gone"])
def test_a_file_of_the_run_that_is_not_as_it_was_is_refused_by_name(name: str, damage: str, tmp_path: Path) -> None:
    begun(tmp_path)
    file = tmp_path / name
    content = file.read_bytes()
    if damage == "gone":
        file.rename(tmp_path / "elsewhere")
    else:
        file.write_bytes(content[:-1] + (b"?" if damage == "altered" else b""))
    if damage == "gone" and name == "manifest.json":
        with pytest.raises(ConfigurationError, match=r"has no manifest\.json"):
            resumed(tmp_path)
        return
    with pytest.raises(RunError, match=f"^{file}: not as it was written"):
        resumed(tmp_path)


def test_what_tells_of_the_files_is_missed_when_it_has_gone(tmp_path: Path) -> None:
    begun(tmp_path)
    for file in (tmp_path / "state" / "recorder").glob("seals.*"):
        file.unlink()
    with pytest.raises(RunError, match="what tells of the run's files is gone"):
        resumed(tmp_path)


def test_a_kill_between_a_new_manifest_and_its_checksum_is_got_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun(tmp_path)
    directory = resumed(tmp_path)

    class Killed(BaseException):
        pass

    def killed(*_: object, **__: object) -> None:
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr("jouleswarm.runs.directory.write_whole", killed)
        with pytest.raises(Killed):
            directory.manifest({"run": "r", "seed": 1, "resumed": [1]})
    assert [each.round for each in resumed(tmp_path).rows] == [1, 2, 3]


ALTERED: dict[str, Any] = {
    "a reward altered": lambda whole: [whole[0], whole[1].replace(b'"reward":null', b'"reward":9.5'), whole[2]],
    "one missing": lambda whole: [whole[0], whole[2]],
    "one twice": lambda whole: [whole[0], whole[0], whole[1], whole[2]],
    "cut short": lambda whole: [whole[0], whole[1][:20]],
    "another order": lambda whole: [whole[0], whole[2], whole[1]],
    "zeros": lambda whole: [whole[0], bytes(len(whole[1]) + len(whole[2]))],
}


@pytest.mark.parametrize("how", ALTERED)
def test_rows_that_are_not_as_they_were_are_cut_off_at_a_resume_and_come_back(how: str, tmp_path: Path) -> None:
    begun(tmp_path)
    file = tmp_path / "rounds.jsonl"
    written = file.read_bytes()
    file.write_bytes(b"".join(ALTERED[how](written.splitlines(keepends=True))))
    directory = resumed(tmp_path)
    assert [each.round for each in directory.rows] == [1]
    directory.round(row(round=4))
    assert "2 rows were lost" in directory.lost_rows()
    directory.complete([row(round=round_) for round_ in (1, 2, 3, 4)])
    assert directory.lost_rows() == ""
    directory.summary({})
    assert file.read_bytes().startswith(written)
    assert [each["round"] for each in lines(file)] == [1, 2, 3, 4]


@pytest.mark.parametrize("how", [*ALTERED, "removed"])
def test_rows_that_are_altered_while_the_run_goes_on_come_back_with_the_list_of_all(how: str, tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    for round_ in (1, 2, 3):
        directory.round(row(round=round_))
    file = tmp_path / "rounds.jsonl"
    if how == "removed":
        file.unlink()
    else:
        file.write_bytes(b"".join(ALTERED[how](file.read_bytes().splitlines(keepends=True))))
    directory.round(row(agent=2, round=1))
    directory.round(row(round=4))
    directory.complete([row(round=round_) for round_ in (1, 2, 3, 4)])
    directory.complete([row(agent=2, round=1)])
    assert directory.lost_rows() == ""
    directory.summary({})
    expected = [row(agent=1, round=round_) for round_ in (1, 2, 3, 4)] + [row(agent=2, round=1)]
    assert directory.rows == expected


def test_rows_lost_after_their_list_of_all_was_told_are_missed(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    for agent in (1, 2):
        directory.complete([row(agent=agent, round=round_) for round_ in (1, 2)])
    file = tmp_path / "rounds.jsonl"
    file.write_bytes(b"".join(file.read_bytes().splitlines(keepends=True)[:3]))
    assert re.fullmatch(rf"{file}: 2 rows were lost, robot 2 in maml", directory.lost_rows())
    assert [(each.agent, each.round) for each in directory.rows] == [(1, 1), (1, 2)]


def test_a_row_that_cannot_be_read_is_an_error_of_ours(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    (tmp_path / "rounds.jsonl").write_bytes(b"\xff\n")
    with pytest.raises(RunError, match=r"rounds\.jsonl: a row is damaged"):
        _ = directory.rows
