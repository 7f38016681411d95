"""`federation.on_missing = "proceed"`: a robot that is gone is left out, and taken back when it returns."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.fleet.deploy import Options, run_deployment
from jouleswarm.fleet.launcher import Launcher
from jouleswarm.fleet.recorder import Recorder
from tests.integration.conftest import DEADLINE_S, ROOT, TOY

# Long enough for a fast machine not to be through with it before the recorder has seen what a signal waits for.
ROUNDS = 300
PROCEED = (
    "methods=['fl']", "federation.on_missing=proceed", "federation.missing_after_s=1", "bus.resend_after_s=1",
    "federation.target_reward=1000", "learning.motions_per_round=2", "learning.batches_per_round=1",
    f"federation.max_rounds={ROUNDS}",
)  # fmt: skip
FEW = 5  # more rounds than a neighbour may be ahead of a robot without leaving it behind
Rows = Sequence[RoundRow]


def is_in_round_2(agent: int) -> Callable[[Rows], bool]:
    return lambda rows: any(row.agent == agent and row.round >= 2 for row in rows)


def robot_2_has_gone_on(rows: Rows) -> bool:
    return sum(row.missed == (1,) for row in rows) >= FEW


class Hand:
    """An intruder who sends robots signals, each when the rows so far are as it says."""

    tick_s = 0.2

    def __init__(self, *plan: tuple[Callable[[Rows], bool], str, signal.Signals]) -> None:
        self.left = list(plan)

    @contextlib.contextmanager
    def line(self, url: str, launcher: Launcher, recorder: Recorder) -> Iterator[str]:
        self.launcher, self.recorder = launcher, recorder
        yield url

    def tick(self) -> None:
        if self.left and self.left[0][0](self.recorder.rows):
            _, robot, sent = self.left.pop(0)
            os.kill(self.launcher.pids[robot], sent)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, read_run: Callable[[Path], Any]) -> Any:
    """Robot 1 is stopped for a while, and robot 3, of the other task, dies."""
    hand = Hand(
        (is_in_round_2(1), "agent-1", signal.SIGSTOP),
        (is_in_round_2(3), "agent-3", signal.SIGKILL),
        (robot_2_has_gone_on, "agent-1", signal.SIGCONT),
    )
    out, intrusion = tmp_path_factory.mktemp("proceed"), Options(restarts=0, intruder=hand)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        path = run_deployment(load_scenario(TOY, PROCEED), "r", out, Console(quiet=True), intrusion)
    assert hand.left == []
    return read_run(path)


def rows_of(run: Any, agent: int) -> list[RoundRow]:
    return [RoundRow.model_validate(row) for row in run.lines("rounds.jsonl") if row["agent"] == agent]


def test_the_others_go_on_without_a_robot_that_dies_and_hand_in_their_model(run: Any, start: Any) -> None:
    dead, widowed, elsewhere = (rows_of(run, agent) for agent in (3, 4, 2))
    assert dead[-1].round < ROUNDS
    assert [row.round for row in widowed] == list(range(ROUNDS + 1))
    assert widowed[0].missed == ()
    assert {row.missed for row in widowed[dead[-1].round + 2 :]} == {(3,)}
    assert (3,) not in {row.missed for row in elsewhere}
    assert (run.path / "weights" / "fl-task2.safetensors").exists()
    assert run.summary["status"] == "complete"
    report = start.jouleswarm("report", str(run.path), "--details")
    assert report.ends(DEADLINE_S) == 0, report.printed
    assert "robot 4 without 3 in" in " ".join(report.printed.split())


def test_a_robot_that_was_stopped_comes_back_into_the_rounds_of_the_others(run: Any) -> None:
    away, other = rows_of(run, 1), rows_of(run, 2)
    assert [row.round for row in other] == list(range(ROUNDS + 1))
    assert {row.missed for row in other} == {(), (1,)}
    assert other[-2].missed == ()
    rounds = [row.round for row in away]
    assert len(rounds) < ROUNDS + 1, "it missed some"
    assert rounds == sorted(set(rounds)), "none twice"
    assert rounds[-1] == ROUNDS
