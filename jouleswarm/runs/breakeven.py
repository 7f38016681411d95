"""Which arms of a run may be compared, and what learning a model first saved there."""

from __future__ import annotations

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.breakeven import Savings, savings
from jouleswarm.energy.prices import PriceList
from jouleswarm.methods.consensus import BASELINE
from jouleswarm.runs.run import Run


def comparable(run: Run) -> list[Arm]:
    """Arms with a stage before that learned all tasks, of a complete run that can be trusted and in which the arm
    without transfer learned all too: a bill at unequal reward is no verdict."""
    held = {arm: all(result.learned for result in results) for arm, results in run.results.items()}
    if run.status != "complete" or run.misfits or not held.get(BASELINE):
        return []
    return [arm for arm in run.scenario.arms if arm.t0 and held[arm.name]]


def savings_of(run: Run, arm: str, energy: Energy, prices: PriceList) -> Savings | None:
    """By one arm with a stage before, over the one without."""
    return savings(run.facts[arm], run.facts[BASELINE], run.scenario.meta.training_tasks, energy, prices)
