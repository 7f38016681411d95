"""What two runs are compared by."""

from __future__ import annotations

import json
from pathlib import Path

from fleet.chaos import outcome


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
