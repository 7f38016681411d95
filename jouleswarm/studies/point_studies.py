"""Studies that are a list of points: sensitivity and regimes; and all methods side by side."""

from __future__ import annotations

from functools import partial

from jouleswarm.common.doors import SHIPPED
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.methods.consensus import BASELINE
from jouleswarm.runs.paper import TRAINING_TASKS
from jouleswarm.studies.beta import MEASURED
from jouleswarm.studies.jobs import Request, Variant, methods_setting
from jouleswarm.studies.kinds import Kind, Plan
from jouleswarm.studies.sweeps import Point, methods_outputs, sweep, sweep_outputs

_TRAINING_SIZES = (1, 2, 3, 6)
_CLUSTER_SIZES = (1, 2, 4, 8)
_BATCHES = (5, 10, 20, 40)
# Of a cluster this large: among 4 robots every 2-regular graph is a ring.
_LARGE_CLUSTER = "federation.robots_per_cluster=8"
_AUTHORS = ("learning.lr=2.5e-4", "learning.target_polyak=1", "learning.target_every=100")
_IN_EARNEST = (
    *("learning.lr=2.5e-4", "learning.target_polyak=1", "learning.target_every=2000", "learning.epsilon=0.1"),
    *('learning.starts="entry"', 'meta.starts="entry"', "meta.epsilon=0.1", "federation.max_rounds=1000"),
)
_EXPLORING = ("learning.epsilon=0.6",)
_ONE_ROBOT = Variant("robots=1", ("federation.robots_per_cluster=1",))


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
    """The scenario's own learning settings; the authors', slow and with a target copied rarely; the same in earnest,
    for both arms: copied ever more rarely, from the entry alone, with as many rounds as it takes; more exploration."""
    return [
        Point("regime", "tuned", ()),
        Point("regime", "authors", _AUTHORS),
        Point("regime", "earnest", _IN_EARNEST),
        Point("regime", "exploring", _EXPLORING),
    ]


def plan_baselines(request: Request) -> Plan:
    """A deployment a seed and method, beta of exact meta-gradients measured; and with one robot a task, which needs no
    sidelinks, learning without transfer and the scenario's own meta-learning."""
    settings = [methods_setting(request.with_plain(*SHIPPED["methods"])), f"meta.t0={request.t0}", MEASURED]
    cheap = Variant(_ONE_ROBOT.label, (*_ONE_ROBOT.overrides, methods_setting([BASELINE, request.meta_method])))
    jobs = [job for variant in (Variant(""), cheap) for job in request.jobs_by_method(settings, variant)]
    return Plan(jobs, settings)


BASELINES = Kind("baselines", 15, 90, plan_baselines, partial(methods_outputs, "Methods side by side"))
SENSITIVITY = Kind(
    "sensitivity", 5, 90, partial(sweep, points=sensitivity_points), partial(sweep_outputs, "One setting at a time")
)
REGIMES = Kind("regimes", 8, 90, partial(sweep, points=regime_points), partial(sweep_outputs, "Learning regimes"))
