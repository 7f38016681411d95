"""What two runs are compared by, and when a fault is due."""

from __future__ import annotations

import json
import random
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from jouleswarm.chaos.chaos import outcome, wrapping
from jouleswarm.chaos.intruder import Chaos
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire.rows import RoundRow

TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"


def run(path: Path, **fields: object) -> Path:
    (path / "weights").mkdir(parents=True)
    (path / "weights" / "fl-task1.safetensors").write_bytes(b"model")
    row = {"arm": "maml", "round": 1, "reward": 74.9, "seconds": 0.1, "refused": 0, "beta": 3.25} | fields
    (path / "rounds.jsonl").write_text(json.dumps(row) + "\n")
    return path


def test_what_was_measured_by_the_clock_is_not_compared(tmp_path: Path) -> None:
    undisturbed = outcome(run(tmp_path / "one"))
    assert outcome(run(tmp_path / "other", seconds=0.7, refused=2, beta=3.5)) == undisturbed


def test_everything_else_is_compared(tmp_path: Path) -> None:
    undisturbed = outcome(run(tmp_path / "one"))
    assert outcome(run(tmp_path / "other", reward=74.95)) != undisturbed
    path = run(tmp_path / "third")
    (path / "weights" / "fl-task1.safetensors").write_bytes(b"other")
    assert outcome(path) != undisturbed


def row(phase: str, round_: int, agent: int) -> RoundRow:
    fields: dict[str, Any] = {"phase": phase, "arm": "maml", "task": 1, "agent": agent, "round": round_, "seconds": 0.1}
    return RoundRow(**fields)


# Two rounds of meta-learning and three of the arms, of four robots; the last of the toy's two arms ends at stage 4.
@pytest.mark.parametrize(
    ("rows", "stages", "phase"),
    [
        ([], {}, "starting"),
        ([row("maml", 1, 1)], {"agent-1": 0}, "meta-learning"),
        ([row("maml", 1, 1), row("fl", 1, 1)], {"agent-1": 1}, "federated"),
        ([row("maml", 1, 1), row("fl", 3, 1)], {"agent-1": 4, "agent-2": 4, "agent-3": 3, "agent-4": 4}, "federated"),
        ([row("maml", 1, 1), row("fl", 3, 1)], {"agent-1": 4, "agent-2": 5, "agent-3": 4, "agent-4": 4}, "leaving"),
        ([row("fl", 1, agent) for agent in (1, 2, 3, 4)] * 4, {"agent-1": 3}, "leaving"),
    ],
)
def test_a_run_is_leaving_when_all_robots_are_done_or_the_last_round_is_coming(
    rows: list[RoundRow], stages: dict[str, int], phase: str, tmp_path: Path
) -> None:
    counts = {"meta-learning": 8, "federated": 12}
    chaos = Chaos(load_scenario(TOY), [], tmp_path / "r", [], 1.0, random.Random(1), counts)
    chaos._recorder, chaos._rows = SimpleNamespace(stages=stages), rows  # type: ignore[assignment]
    assert chaos.phase == phase


def test_the_end_of_a_run_is_looked_at_more_often(tmp_path: Path) -> None:
    chaos = Chaos(
        load_scenario(TOY), [], tmp_path / "r", [], 1.0, random.Random(1), {"meta-learning": 8, "federated": 12}
    )
    chaos._rows = [row("fl", 1, 1)] * 14  # 6 of 20 are left
    assert chaos.tick_s == 0.2
    chaos._rows = [row("fl", 1, 1)] * 15
    assert chaos.tick_s == 0.01


def test_the_memories_of_motions_are_written_over_after_a_few_rounds() -> None:
    scenario = load_scenario(TOY)  # 10 motions a round, of 500 that are kept; the data center keeps 5000
    assert wrapping(scenario) == ["learning.replay_size=10", "meta.replay_size=10"]
    small = load_scenario(TOY, ["learning.replay_size=4", "learning.motions_per_round=2"])
    assert wrapping(small) == ["learning.replay_size=3", "meta.replay_size=3"]  # a scenario may not have less
