"""What a budget reaches, worked out by hand."""

from __future__ import annotations

import pandas as pd

from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.curves import curve, until
from jouleswarm.energy.facts import STAGE, Counts, Facts, Flow, Work
from jouleswarm.runs.curves import within

# A stage of 100 bytes up; task 1 takes 2 rounds of 5 gradients, task 2 four of 10, task 3 is not learned in 4.
FACTS = Facts(
    "maml",
    "maml",
    t0=1,
    parts={
        ("ml", STAGE): Counts(uplink_bytes=100),
        ("fl", 1): Counts(gradients_robots=10),
        ("fl", 2): Counts(gradients_robots=40),
        ("fl", 3): Counts(gradients_robots=8),
    },
    rounds={1: 2, 2: 4, 3: 4},
    known_flows=(Flow("fl", 2, Link.SIDELINK, "agent-1", "agent-2", 4, 400, 440),),
    known_work=(Work("fl", 2, 1, 40, 0, 8.0, 4, 80, 20), Work("ml", 1, 0, 5, 5, 1.0, 1)),
    known_sent=(),
)
LEARNED = {1: True, 2: True, 3: False}


def _total(facts: Facts) -> float:
    counts = facts.counts
    return counts.ml.uplink_bytes + counts.fl.gradients_robots


def test_clusters_learn_side_by_side_after_the_stage() -> None:
    assert [(point.round, _total(point.facts), point.learned) for point in curve(FACTS, LEARNED)] == [
        (0, 100, ()),
        (1, 100 + 5 + 10 + 2, ()),
        (2, 100 + 10 + 20 + 4, (1,)),
        (3, 100 + 10 + 30 + 6, (1,)),
        (4, 158, (1, 2)),
    ]


def test_a_budget_reaches_the_last_round_that_it_pays_for() -> None:
    rows = [("maml", point.round, _total(point.facts)) for point in curve(FACTS, LEARNED)]
    points = pd.DataFrame(rows, columns=["arm", "round", "joules"])

    def reached(budget: float) -> int | None:
        last = within(points, budget)["maml"]
        return None if last is None else int(last["round"])

    assert [reached(budget) for budget in (99, 116.9, 134, 1e6)] == [None, 0, 2, 4]


def test_flows_and_work_are_cut_with_their_task_and_the_stage_stays_whole() -> None:
    after = until(FACTS, 1)
    assert after.flows == (Flow("fl", 2, Link.SIDELINK, "agent-1", "agent-2", 1, 100, 110),)
    assert after.work == (Work("fl", 2, 1, 10, 0, 2.0, 1, 20, 5), Work("ml", 1, 0, 5, 5, 1.0, 1))
    assert after.rounds == {1: 1, 2: 1, 3: 1}
    assert until(FACTS, 9) == FACTS


def test_a_task_that_took_no_round_is_learned_from_the_start() -> None:
    facts = Facts("a", "fl", 0, parts={("fl", 1): Counts()}, rounds={1: 0})
    (point,) = curve(facts, {1: True})
    assert (point.round, _total(point.facts), point.learned) == (0, 0, (1,))
