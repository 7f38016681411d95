"""What `report.html` has in it as JSON: the facts, so that its script can price them again, and the curves of R."""

from __future__ import annotations

from collections import defaultdict
from statistics import fmean
from typing import Any

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.links import DATA_CENTER
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.bill import CAUSES
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import with_beta
from jouleswarm.report.answer import short_labels
from jouleswarm.report.arms import labels, looks
from jouleswarm.report.look import dashes
from jouleswarm.report.sliders import SLIDERS
from jouleswarm.runs.answer import Answer
from jouleswarm.runs.run import Run

_CONSTANTS = ("pue", "base_station_pue", "dl_bit_per_j", "sidelink", "motion_j", "forward_j")


def page_data(run: Run, energy: Energy, found: Answer) -> dict[str, Any]:
    """Arms with what was counted, constants, sliders, and R by task, arm and round.

    Where robots or links have constants of their own, or waiting costs, sums are not enough to price again: arms have
    no counts then, and the page no sliders.
    """
    names, short, held = labels(run.scenario), short_labels(run.scenario), looks(run.scenario)
    can = energy.is_alike and all(facts.metered for facts in run.facts.values())
    arms = [
        {
            "arm": arm,
            "name": names[arm],
            "short": short[arm],
            "colour": held[arm].colour,
            "dash": dashes(held[arm].line),
            "causes": spent.by_cause_j,
            "total": spent.total_j,
            "counts": counts_of(run.facts[arm]) if can else None,
            "beta": with_beta(energy, run.facts[arm]).beta if can else None,
        }
        for arm, spent in found.arms.items()
    ]
    constants = {name: getattr(energy, name) for name in (*_CONSTANTS, *(each.key for each in SLIDERS))}
    constants["datacenter_g_per_kwh"] = energy.intensity_of(DATA_CENTER)
    constants["robots_g_per_kwh"] = energy.intensity_of(None)
    return {
        "arms": arms,
        "plain": found.plain,
        "compared": [each.arm for each in found.against],
        "causes": [{"key": cause.key, "label": cause.label} for cause in CAUSES],
        "constants": constants,
        "sliders": [each._asdict() for each in SLIDERS] if can else [],
        "target": run.scenario.federation.target_reward,
        "rewards": rewards(run),
    }


def counts_of(facts: Facts) -> dict[str, float]:
    """Sums of both phases; motions from where they are known."""
    counts = vars(facts.counts.ml + facts.counts.fl)
    if facts.known_work is None:
        return counts
    robots = [each for each in facts.known_work if each.robot != DATA_CENTER]
    acted = {name: sum(getattr(each, name) for each in robots) for name in ("motions", "evaluation_motions")}
    return counts | acted


def rewards(run: Run) -> dict[str, dict[str, list[tuple[int, float]]]]:
    """Task -> arm -> (round, R), the mean where each robot has its own; numbers to four digits."""
    found: dict[tuple[int, str, int], list[float]] = defaultdict(list)
    for row in run.rows:
        if row.phase == RowPhase.FL and row.agent and row.cluster_reward is not None:
            found[row.task, row.arm, row.round].append(row.cluster_reward)
    told: dict[str, dict[str, list[tuple[int, float]]]] = {str(task): {} for task in run.scenario.clusters}
    for (task, arm, round_), values in sorted(found.items()):
        told[str(task)].setdefault(arm, []).append((round_, float(f"{fmean(values):.4g}")))
    return told
