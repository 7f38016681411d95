"""Processes are killed, and the run comes to the same end: the same rounds, bit-identical weights."""

from __future__ import annotations

import contextlib
import functools
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from rich.console import Console

from jouleswarm.chaos.chaos import outcome
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.fleet.deploy import Options, run_deployment
from jouleswarm.fleet.launcher import Launcher
from jouleswarm.fleet.recorder import Recorder

ROOT = Path(__file__).parents[2]
TOY = str(ROOT / "scenarios" / "toy.toml")
DEADLINE_S = 170.0  # a busy machine takes its time
# Long enough that a run is still under way when its first row of a phase has been seen.
LONGER = (
    "federation.max_rounds=12", "federation.target_reward=1000", "meta.t0=8", "learning.motions_per_round=6",
    "learning.batches_per_round=4", "bus.resend_after_s=3",
)  # fmt: skip

pytestmark = pytest.mark.timeout(600)


def sets(overrides: tuple[str, ...]) -> list[str]:
    return [part for each in overrides for part in ("--set", each)]


@pytest.fixture(scope="module")
def undisturbed(run_toy: Any) -> Any:
    return outcome(run_toy("longer", *LONGER).path)


def has_row(path: Path, phase: str) -> bool:
    rounds = path / "rounds.jsonl"
    return rounds.exists() and f'"phase":"{phase}"' in rounds.read_text()


def marked(mark: str) -> list[psutil.Process]:
    """Everything alive that was started with TEST_MARK=mark, the launcher first."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            if process.environ().get("TEST_MARK") == mark and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return sorted(found, key=lambda each: each.create_time())


def test_a_run_of_which_everything_was_killed_is_gone_on_with_to_the_same_end(
    undisturbed: Any, start: Any, eventually: Any, read_run: Any, tmp_path: Path
) -> None:
    path = tmp_path / "r"
    begin = ("run", TOY, "--out", str(tmp_path), "--run-id", "r", *sets(LONGER))
    resume = ("run", "--resume", str(path), "--no-figures")
    for phase, command in (("maml", begin), ("fl", resume)):
        run = start.jouleswarm(*command, TEST_MARK=str(path))
        eventually(functools.partial(has_row, path, phase), f"a row of {phase}")
        for process in marked(str(path)):
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()
        assert run.ends(DEADLINE_S) == -signal.SIGKILL
        eventually(lambda: not marked(str(path)), "the end of all")
        assert not (path / "summary.json").exists()
    report = start.jouleswarm("report", str(path))
    assert report.ends(DEADLINE_S) == 0, report.printed
    assert "interrupted" in report.printed

    resumed = start.jouleswarm(*resume)
    assert resumed.ends(DEADLINE_S) == 0, resumed.printed
    assert outcome(path) == undisturbed
    assert not (path / "state").exists()
    done = read_run(path)
    assert done.summary["status"] == "complete"
    assert len(done.manifest["resumed"]) == 2


class Killer:
    """An intruder who kills some processes, each when the federated phase has come to its second round."""

    tick_s = 0.2

    def __init__(self, *names: str) -> None:
        self.names, self.left = names, list(names)

    @contextlib.contextmanager
    def line(self, url: str, launcher: Launcher, recorder: Recorder) -> Iterator[str]:
        self.launcher, self.recorder = launcher, recorder
        yield url

    def tick(self) -> None:
        if self.left and any(row.phase == "fl" and row.round == 2 for row in self.recorder.rows):
            os.kill(self.launcher.pids[self.left.pop()], signal.SIGKILL)


def deploy(out: Path, killer: Killer, *overrides: str) -> Path:
    scenario = load_scenario(TOY, overrides)
    return run_deployment(scenario, "r", out, Console(quiet=True), Options(restarts=5, intruder=killer))


def counts(run: Any, side: str, direction: str) -> dict[tuple[str, str], int]:
    """(client, topic) -> messages."""
    return {
        (row["client"], row["topic"]): row["messages"]
        for row in run.lines("meter.jsonl")
        if (row["side"], row["direction"]) == (side, direction)
    }


def test_robots_that_are_killed_come_back_to_the_same_end_and_no_byte_is_lost_from_the_books(
    undisturbed: Any, read_run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    killer = Killer("agent-2", "agent-3")
    path = deploy(tmp_path, killer, *LONGER)
    assert killer.left == []
    assert outcome(path) == undisturbed
    run = read_run(path)
    delivered, acknowledged = counts(run, "broker", "out"), counts(run, "broker", "acked")
    received, repeated = counts(run, "client", "in"), counts(run, "client", "repeated")
    for key, messages in delivered.items():
        assert acknowledged.get(key, 0) <= received.get(key, 0) <= messages, key
    assert received.keys() <= delivered.keys()
    assert all(messages <= received[key] for key, messages in repeated.items())
    # Only of the two that were killed can anything have been lost.
    assert {key[0] for key, messages in delivered.items() if received.get(key, 0) < messages} <= set(killer.names)


class LateKiller(Killer):
    """It kills when all counters have been handed in, and only the broker's are still to be asked for."""

    def tick(self) -> None:
        if self.left and not self.recorder.waiting_for:
            os.kill(self.launcher.pids[self.left.pop()], signal.SIGKILL)


def test_a_broker_that_is_killed_before_it_has_told_its_counters_comes_back_and_tells_them(
    read_run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    killer = LateKiller("broker")
    run = read_run(deploy(tmp_path, killer, 'methods=["fl"]', "federation.max_rounds=1"))
    assert killer.left == []
    assert (run.summary["status"], run.summary["metered_by"]) == ("complete", "broker")


def test_chaos_finds_the_same_end_after_every_fault(start: Any, tmp_path: Path) -> None:
    # Each in another phase, so that one run takes them all; robots that are killed are in the tests above.
    kinds = ("state torn", "state lost", "disk full", "broker killed")
    chosen = [part for kind in kinds for part in ("--kind", kind)]
    options = ("--faults", "4", "--pause-s", "1", "--seed", "1", "--out", str(tmp_path / "chaos"))
    long_enough = sets((*LONGER, "federation.max_rounds=40"))
    process = start.jouleswarm("chaos", TOY, *options, *chosen, *long_enough, COLUMNS="200")
    assert process.ends(500) == 0, process.printed
    assert "4 faults, 4 of them in runs with an identical end" in " ".join(process.printed.split())
    rows = [row.split(",") for row in (tmp_path / "chaos" / "chaos.csv").read_text().splitlines()[1:]]
    assert {(row[2], row[1]) for row in rows} == {
        ("state torn", "starting"), ("state lost", "meta-learning"), ("disk full", "federated"),
        ("broker killed", "leaving"),
    }  # fmt: skip
    assert {(row[2], row[-1]) for row in rows if row[-1]} == {("state lost", "refused"), ("disk full", "no space left")}
