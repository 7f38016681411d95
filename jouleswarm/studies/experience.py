"""What experience is worth: one rule for all robots against rules of their own, and a rule's parts one at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.report.table import Cell, Table
from jouleswarm.studies.arms import PLAIN, failures_of
from jouleswarm.studies.columns import rounds_sum
from jouleswarm.studies.estimates import estimate
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.kinds import Kind, Outputs
from jouleswarm.studies.prices import runs_of
from jouleswarm.studies.record import Record
from jouleswarm.studies.sweeps import Point, sweep, sweep_outputs
from jouleswarm.studies.tables import spread

_EPSILONS = (0.1, 0.3, 0.6)
_STARTS = ("area", "anywhere", "entry")
_BEFORE = (0.6, "anywhere")
"""What the data center's experience was collected by before there was one rule."""
_OF_ROBOTS = ('learning.collect="own"', "learning.epsilon=0.1", 'learning.starts="area"')


def experience_points(scenario: Scenario) -> list[Point]:
    """Whom robots follow, the share of random actions and where episodes start, of all robots alike; and the rule of
    results from before, of which `guided` is the control arm: all robots collect as the data center's did.

    `own`: the data center's training robots have no model to follow, and go on by the guide; `unguided`: at random.
    """
    own = 'learning.collect="own"'
    points = [
        Point("policy", "guide", ('learning.collect="guide"',)),
        Point("policy", "own", (own,)),
        Point("policy", "unguided", (own, "meta.epsilon=1.0")),
    ]
    points += [Point("epsilon", str(each), _alike(scenario, "epsilon", str(each))) for each in _EPSILONS]
    points += [Point("starts", each, _alike(scenario, "starts", f'"{each}"')) for each in _STARTS]
    epsilon, starts = _BEFORE
    datacenter = (f"meta.epsilon={epsilon}", f'meta.starts="{starts}"')
    both = (_alike(scenario, "epsilon", str(epsilon)), _alike(scenario, "starts", f'"{starts}"'))
    return [
        *points,
        Point("before", "now", ()),
        Point("before", "before", (*_OF_ROBOTS, *datacenter)),
        Point("before", "guided", ('learning.collect="guide"', *both[0], *both[1])),
    ]


def _alike(scenario: Scenario, what: str, value: str) -> tuple[str, ...]:
    """A part of the rule, of all robots; the data center's own is said only where the scenario says one."""
    own = () if getattr(scenario.meta, what) is None else (f"meta.{what}={value}",)
    return (f"learning.{what}={value}", *own)


def worth_csv(facts: Sequence[Fact], groups: dict[str, dict[str, str]]) -> Table:
    """A row a thing that is varied, value and arm with transfer: rounds of both arms over all tasks, and the gain.

    The gain is rounds without over rounds with transfer, seed by seed; empty where a seed's tasks took none. What was
    not learned counts as it ran.
    """
    columns = ("what", "value", "variant", "arm", "without", "without_ci95", "with", "with_ci95", "gain", "gain_ci95")
    counted = ("seeds", "without_not_learned", "with_not_learned", "trials")
    return Table("What experience is worth", (*columns, *counted), list(_worth(facts, groups)))


def _worth(facts: Sequence[Fact], groups: dict[str, dict[str, str]]) -> Iterator[tuple[Cell, ...]]:
    for what, variants in groups.items():
        for value, variant in variants.items():
            without = runs_of(facts, variant, PLAIN)
            arms = dict.fromkeys(each.arm for each in facts if (each.variant, each.arm == PLAIN) == (variant, False))
            for arm in arms:
                runs = runs_of(facts, variant, arm)
                pairs = [(rounds_sum(without[seed]), rounds_sum(run)) for seed, run in runs.items() if seed in without]
                if not pairs:
                    continue
                gain = estimate(plain / moved for plain, moved in pairs) if all(moved for _, moved in pairs) else None
                told = (estimate(plain for plain, _ in pairs), estimate(moved for _, moved in pairs), gain)
                cells = [cell for each in told for cell in spread(each)]
                failed, trials = failures_of(facts, variant, arm)
                row = (what, value, variant, arm, *cells, len(pairs))
                yield (*row, failures_of(facts, variant, PLAIN)[0], failed, trials)


def outputs(facts: Sequence[Fact], record: Record) -> Outputs:
    """The comparison of all variants, a figure for each thing that is varied, and what each choice is worth."""
    made = sweep_outputs("Experience, one choice at a time", facts, record)
    made.csv["worth"] = worth_csv(facts, record.groups)
    return made


KIND = Kind("experience", 5, 90, partial(sweep, points=experience_points), outputs)
