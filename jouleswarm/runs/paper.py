"""What the paper prints, each number with its place, and which arms it says anything about.

Savazzi, Rampa, Kianoush, Bennis, "On the Energy and Communication Efficiency Tradeoffs in Federated and Multi-Task
Learning", 2022, arXiv 2212.01049. Its other constants (Table I) are the defaults of `common.scenario.sections.Energy`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.closed_form import TABLE_I
from jouleswarm.energy.published import CLUSTER_ROBOTS, TRAINING_ROBOTS
from jouleswarm.methods.shipped import shipped
from jouleswarm.runs.sizes import scenario_sizes

# Table II: MAML rounds t0 -> FL rounds t_1 .. t_6, means of 15 Monte Carlo runs. 0 is "no MAML".
TABLE_II: dict[int, tuple[float, ...]] = {
    0: (380.1, 129.6, 93.7, 211.5, 24.2, 82.4),
    42: (29.7, 56.4, 70.9, 87.0, 70.4, 57.1),
    66: (178.8, 9.9, 14.3, 104.6, 9.8, 12.4),
    90: (84.9, 8.9, 15.6, 166.2, 11.3, 19.6),
    132: (11.6, 25.5, 25.1, 44.6, 23.1, 23.8),
    210: (6.7, 29.1, 16.5, 27.7, 32.0, 17.2),
    240: (2.7, 10.8, 9.1, 40.0, 21.8, 19.6),
}
TRAINING_TASKS = (1, 2, 6)  # section IV-A
_CONSTANTS = ("p0_w", "t0_batch_s", "pk_w", "tk_batch_s", "pue", "sidelink")


class PrintedTotal(NamedTuple):
    """A total that section IV prints."""

    ul_bit_per_j: float
    sl_bit_per_j: float
    t0: int
    ml_j: float | None
    total_j: float


NO_MAML = PrintedTotal(200e3, 500e3, 0, None, 227e3)  # section IV-B
HEADLINE = PrintedTotal(200e3, 500e3, 210, 74e3, 106e3)  # section IV-B, Fig. 3a
BEST_SIDELINK = PrintedTotal(200e3, 500e3, 42, None, 56e3)  # section IV-C, Fig. 4a, black
BEST_UPLINK = PrintedTotal(500e3, 200e3, 132, None, 52e3)  # section IV-C, Fig. 4a, red


def is_papers_deployment(scenario: Scenario) -> bool:
    """Whether a round computes and moves for as many robots as the paper's: 3 that train, and clusters of 2."""
    training = sum(len(agents) for agents in scenario.training_agents.values())
    sizes = {len(cluster) for cluster in scenario.clusters.values()}
    return training == TRAINING_ROBOTS and sizes == {CLUSTER_ROBOTS}


def is_papers_scenario(scenario: Scenario, energy: Energy) -> bool:
    """Whether it is the paper's own experiment that is priced: its tasks, batches, bytes and Table I."""
    return (
        is_papers_deployment(scenario)
        and len(scenario.clusters) == len(TABLE_II[0])
        and scenario.meta.training_tasks == TRAINING_TASKS
        and all(getattr(energy, name) == getattr(Energy(), name) for name in _CONSTANTS)
        and all(
            math.isclose(getattr(scenario_sizes(scenario), name), getattr(TABLE_I, name), rel_tol=0.01)
            for name in ("support_batches", "query_batches", "robot_batches", "experience_bytes", "weights_bytes")
        )
    )


def printed_total(method: str, t0: int, ul_bit_per_j: float, sl_bit_per_j: float) -> PrintedTotal | None:
    """The printed total nearest to an arm: of its method and efficiencies, of its t0 if there is one for it."""
    kind = shipped(method)
    if kind is None or not kind.in_paper:
        return None
    totals = (NO_MAML,) if kind.stage is None else (HEADLINE, BEST_SIDELINK, BEST_UPLINK)
    fitting = [each for each in totals if (each.ul_bit_per_j, each.sl_bit_per_j) == (ul_bit_per_j, sl_bit_per_j)]
    return next((each for each in fitting if each.t0 == t0), fitting[0] if fitting else None)
