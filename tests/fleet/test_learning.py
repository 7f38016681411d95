"""A run in which nobody computed a gradient is not complete."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.errors import RunError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.fleet.learning import check_learning

TOY = load_scenario(Path(__file__).parents[2] / "scenarios" / "toy.toml", ["meta.adapt_from=[2]"])  # maml, fl


def row(phase: str, arm: str, gradients: int, **more: Any) -> RoundRow:
    fields = {"phase": phase, "arm": arm, "task": 1, "agent": 1, "round": 1, "gradients": gradients, "seconds": 0.0}
    return RoundRow.model_validate({**fields, **more})


ROWS = [row("maml", "maml", 8, agent=0), row("fl", "maml-t2", 4), row("fl", "maml", 4), row("fl", "fl", 4)]


def test_a_gradient_in_every_stage_is_enough() -> None:
    check_learning(TOY, ROWS)


@pytest.mark.parametrize(
    ("missing", "told"),
    [(0, "the meta-learning of maml"), (1, "arm maml-t2"), (2, "arm maml"), (3, "arm fl")],
)
def test_a_stage_without_is_named(missing: int, told: str) -> None:
    rows = [each.model_copy(update={"gradients": 0}) if place == missing else each for place, each in enumerate(ROWS)]
    with pytest.raises(RunError, match=f"nobody computed a gradient in {told}; expected some in each"):
        check_learning(TOY, rows)
