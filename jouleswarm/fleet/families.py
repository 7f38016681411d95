"""A run as families of Prometheus metrics. Pure; labels are of the scenario only, so that no message adds a series."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Protocol

from prometheus_client import Metric
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.bill import PAPER_CAUSES, Cost
from jouleswarm.energy.facts import Counts, Phase

Costs = Mapping[tuple[str, Phase], Cost]
Done = Mapping[tuple[str, Phase], Counts]
"""By arm and phase."""

_STATES = ("awaited", "here", "gone", "done")
_ALL = "all"
"""In place of a task: the stage is of all tasks together."""


class Heard(Protocol):
    """What is known of a run while it goes on; the recorder knows."""

    @property
    def newest(self) -> Mapping[tuple[str, int, int], RoundRow]:
        """(arm, task, agent) -> its newest row."""

    @property
    def robots(self) -> Counter[str]:
        """State -> how many robots."""

    @property
    def refused(self) -> int:
        """Messages that it could not read."""

    @property
    def elapsed_s(self) -> float:
        """Since the run began, seconds."""


def families(scenario: Scenario, version: str, heard: Heard, done: Done, costs: Costs) -> Iterator[Metric]:
    """All of them, in a stable order."""
    told = {"scenario": scenario.name, "seed": str(scenario.seed), "version": version}
    yield InfoMetricFamily("jouleswarm_run", "the run that is recorded", value=told)
    yield GaugeMetricFamily("jouleswarm_run_elapsed_seconds", "since the recorder began", value=heard.elapsed_s)
    target = scenario.federation.target_reward
    yield GaugeMetricFamily("jouleswarm_reward_target", "R from which a task is learned", value=target)
    robots = GaugeMetricFamily("jouleswarm_robots", "robots by state", labels=("state",))
    for state in _STATES:
        robots.add_metric([state], heard.robots[state])
    yield robots
    yield from _learning(scenario, heard)
    yield from _spent(done, costs)
    refused = CounterMetricFamily(
        "jouleswarm_refused_messages", "messages refused, by whom and why", labels=("by", "reason")
    )
    refused.add_metric(["recorder", "payload"], heard.refused)
    by: dict[int, int] = {}
    for (_, _, agent), row in heard.newest.items():
        by[agent] = max(by.get(agent, 0), row.refused)
    for agent, count in sorted(by.items()):
        refused.add_metric([client_of(agent), "payload"], count)
    yield refused


def _learning(scenario: Scenario, heard: Heard) -> Iterator[Metric]:
    rounds = GaugeMetricFamily("jouleswarm_round", "the slowest robot's round", labels=("arm", "phase", "task"))
    rewards = GaugeMetricFamily("jouleswarm_reward", "R of a cluster", labels=("arm", "task"))
    learned = GaugeMetricFamily("jouleswarm_learned", "1: R has reached its target, 0: not", labels=("arm", "task"))
    for method in scenario.meta_methods:
        stage = [
            row.round
            for (arm, _, agent), row in heard.newest.items()
            if (arm, agent, row.phase) == (method, 0, RowPhase.ML)
        ]
        rounds.add_metric([method, "ml", _ALL], max(stage, default=0))
    for arm in scenario.arm_names:
        for task, cluster in scenario.clusters.items():
            found = (heard.newest.get((arm, task, agent)) for agent in cluster)
            rows = [row for row in found if row is not None and row.phase == RowPhase.FL]
            if not rows:
                continue
            slowest, label = min(rows, key=lambda row: row.round), [arm, str(task)]
            rounds.add_metric([arm, "fl", str(task)], slowest.round)
            if slowest.cluster_reward is not None:
                rewards.add_metric(label, slowest.cluster_reward)
            learned.add_metric(label, len(rows) == len(cluster) and all(row.learned for row in rows))
    yield from (rounds, rewards, learned)


def _spent(done: Done, costs: Costs) -> Iterator[Metric]:
    joules = CounterMetricFamily(
        "jouleswarm_energy_joules",
        "energy by the equations, at the scenario's prices",
        labels=("arm", "phase", "cause"),
    )
    for (arm, phase), cost in costs.items():
        for cause, spent_j in cost.by_cause.items():
            if spent_j or cause in PAPER_CAUSES:
                joules.add_metric([arm, phase, cause.key], spent_j)
    moved = CounterMetricFamily(
        "jouleswarm_payload_bytes", "payload delivered over links that are priced", labels=("arm", "phase", "link")
    )
    gradients = CounterMetricFamily("jouleswarm_gradients", "batch gradients computed", labels=("arm", "phase", "site"))
    for (arm, phase), counts in done.items():
        for link in ("uplink", "downlink", "sidelink"):
            moved.add_metric([arm, phase, link], getattr(counts, f"{link}_bytes"))
        gradients.add_metric([arm, phase, "datacenter"], counts.gradients_support + counts.gradients_query)
        gradients.add_metric([arm, phase, "robots"], counts.gradients_robots)
    yield from (joules, moved, gradients)
