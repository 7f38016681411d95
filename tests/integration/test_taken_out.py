"""A robot that is taken out of a run's keys on the way: the others go on without it where the scenario says so."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from jouleswarm.common.errors import RunError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.fleet.deploy import Options, run_deployment
from jouleswarm.fleet.keys import make_keys, remove_keys
from jouleswarm.fleet.launcher import Launcher
from jouleswarm.fleet.recorder import Recorder
from tests.integration.conftest import ROOT, TOY

ROUNDS = 100
ALWAYS = (
    "methods=['fl']", "bus.resend_after_s=1", "federation.target_reward=1000", "learning.motions_per_round=2",
    "learning.batches_per_round=1", f"federation.max_rounds={ROUNDS}",
)  # fmt: skip
PROCEED = (*ALWAYS, "federation.on_missing=proceed", "federation.missing_after_s=1")


class Keeper:
    """An intruder who keeps the keys, and takes robot 3 out once it has done two rounds."""

    tick_s = 0.1

    def __init__(self, keys: Path) -> None:
        self.keys, self.is_done = keys, False

    @contextlib.contextmanager
    def line(self, url: str, launcher: Launcher, recorder: Recorder) -> Iterator[str]:
        self.launcher, self.recorder = launcher, recorder
        yield url

    def tick(self) -> None:
        if not self.is_done and any(row.agent == 3 and row.round >= 2 for row in self.recorder.rows):
            remove_keys(self.keys, ["agent-3"])
            os.kill(self.launcher.pids["broker"], signal.SIGHUP)
            self.is_done = True


def run_with_keys(settings: tuple[str, ...], folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(ROOT)
    scenario = load_scenario(TOY, settings)
    make_keys(scenario, folder / "keys", ["127.0.0.1", "localhost"], 2)
    keeper = Keeper(folder / "keys")
    options = Options(restarts=1, intruder=keeper, keys=folder / "keys")
    with (folder / "told").open("w") as told:
        path = run_deployment(scenario, "r", folder, Console(file=told, width=500), options)
    assert keeper.is_done
    return path


def test_the_others_go_on_without_it_and_the_run_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read_run: Callable[[Path], Any]
) -> None:
    run = read_run(run_with_keys(PROCEED, tmp_path, monkeypatch))
    rows = [RoundRow.model_validate(row) for row in run.lines("rounds.jsonl")]
    gone, neighbour = ([row for row in rows if row.agent == agent] for agent in (3, 4))
    assert gone[-1].round < ROUNDS
    assert [row.round for row in neighbour] == list(range(ROUNDS + 1))
    assert neighbour[-1].missed == (3,)
    assert run.summary["status"] == "complete"
    assert "agent-3 is no user of the broker any more; the others go on without it" in (tmp_path / "told").read_text()
    assert "and had let it in before" in (run.path / "logs" / "agent-3.log").read_text()


def test_where_all_are_waited_for_the_run_ends_with_its_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = r"agent-3 ended with code 7: robot 3: broker .* refused user 'agent-3': .*, and had let it in before"
    with pytest.raises(RunError, match=told):
        run_with_keys(ALWAYS, tmp_path, monkeypatch)
