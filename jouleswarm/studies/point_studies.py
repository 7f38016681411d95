"""Studies that are a list of points: sensitivity and regimes; and all methods side by side."""

from __future__ import annotations

from functools import partial

from jouleswarm.common.doors import SHIPPED
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.runs.paper import TRAINING_TASKS
from jouleswarm.studies.jobs import Request, Variant, methods_setting
from jouleswarm.studies.kinds import Kind, Plan
from jouleswarm.studies.sweeps import Point, methods_outputs, sweep, sweep_outputs

_TRAINING_SIZES = (1, 2, 3, 6)
_CLUSTER_SIZES = (1, 2, 4, 8)
_BATCHES = (5, 10, 20, 40)
# Of a cluster this large: among 4 robots every 2-regular graph is a ring.
_LARGE_CLUSTER = "federation.robots_per_cluster=8"
_AUTHORS = ("learning.lr=2.5e-4", "learning.target_polyak=1", "learning.target_every=100")
_EXPLORING = ("learning.epsilon=0.6",)


def sensitivity_points(scenario: Scenario) -> list[Point]:
    """Training tasks Q, cluster size, topology and batches a round, one at a time."""
    ids = [task.id for task in scenario.tasks]
    ordered = [task for task in TRAINING_TASKS if task in ids]
    ordered += [task for task in ids if task not in ordered]
    sizes = [size for size in _TRAINING_SIZES if size <= len(ordered)]
    points = [Point("Q", str(size), (f"meta.training_tasks={sorted(ordered[:size])}",)) for size in sizes]
    points += [Point("robots", str(size), (f"federation.robots_per_cluster={size}",)) for size in _CLUSTER_SIZES]
    points += [
        Point("topology", "full", ('federation.topology="full"', _LARGE_CLUSTER)),
        Point("topology", "ring", ('federation.topology="ring"', _LARGE_CLUSTER)),
        Point("topology", "random", ('federation.topology="random"', "federation.degree=3", _LARGE_CLUSTER)),
    ]
    return points + [Point("batches", str(count), (f"learning.batches_per_round={count}",)) for count in _BATCHES]


def regime_points(scenario: Scenario) -> list[Point]:
    """The scenario's own learning settings; the authors', slow and with a target copied rarely; more exploration."""
    return [
        Point("regime", "tuned", ()),
        Point("regime", "authors", _AUTHORS),
        Point("regime", "exploring", _EXPLORING),
    ]


def plan_baselines(request: Request) -> Plan:
    """One deployment a seed, every method an arm of it."""
    settings = [methods_setting(SHIPPED["methods"]), f"meta.t0={request.t0}"]
    return Plan(request.jobs([Variant("")], settings), settings)


BASELINES = Kind("baselines", 5, 90, plan_baselines, partial(methods_outputs, "Methods side by side"))
SENSITIVITY = Kind(
    "sensitivity", 3, 90, partial(sweep, points=sensitivity_points), partial(sweep_outputs, "One setting at a time")
)
REGIMES = Kind("regimes", 5, 90, partial(sweep, points=regime_points), partial(sweep_outputs, "Learning regimes"))
