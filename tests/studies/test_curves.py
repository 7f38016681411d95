"""Curves of a study by hand: what had been spent when each task was learned, and its statistics."""

from __future__ import annotations

import math

import numpy as np
import pytest

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.studies.curves import curves_csv, profile, to_learn
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import with_motions
from tests.studies.made_up import pair_of_arms


def test_all_clusters_spend_until_a_task_is_learned(scenario: Scenario) -> None:
    facts = with_motions(pair_of_arms("", 1, 10, 20), scenario)  # 21 to 26 rounds without
    costs = to_learn(facts, "fl", Energy())
    # When task 1 was learned six clusters had done 21 rounds each; at the last 22 to 26 of their own, 21 + ... + 26.
    for what, a_round in {"joules": 260.8, "bits": 89.6e6, "gradients": 40, "motions": 40}.items():
        assert costs[what][0, [0, 5]] == pytest.approx([6 * 21 * a_round, 141 * a_round]), what
    # With a stage before: 42 rounds of 3 robots x 20 motions and 60 batches, and 11 rounds of six clusters.
    with_it = to_learn(facts, "maml", Energy())
    assert with_it["motions"][0, 0] == 42 * 60 + 66 * 40
    assert with_it["gradients"][0, 0] == 42 * 60 + 66 * 40


def test_a_task_that_was_not_learned_is_never_reached() -> None:
    facts = [fact.model_copy(update={"learned": fact.task != 2}) for fact in pair_of_arms("", 1, 10, 20)]
    assert np.isinf(to_learn(facts, "fl", Energy())["joules"]).tolist() == [[False, True, *[False] * 4]]


def test_share_and_interquartile_mean_of_tasks_learned() -> None:
    costs = np.array([[1.0, 2.0], [1.0, 3.0], [1.0, 4.0], [1.0, math.inf]])  # 4 seeds x 2 tasks
    share, iqm = profile(costs, np.array([0.5, 1.0, 2.0, 4.0]))
    assert share[0].tolist() == [0, 4 / 8, 5 / 8, 7 / 8]
    # Of eight scores two are cut at each end: of the middle four 2, 3 and 4 are ones.
    assert iqm[0].tolist() == [0, 2 / 4, 3 / 4, 1]
    # At budget 1 all seeds have task 1 and none task 2: drawing seeds again within each task changes nothing.
    assert share[1:, 1].tolist() == iqm[1:, 1].tolist() == [0.5, 0.5]
    # At budget 2 one of task 2's four seeds is learned: drawn 0 to 3 times in more than 95% of draws.
    assert share[1:, 2].tolist() == [4 / 8, 7 / 8]


def test_one_seed_has_no_interval(scenario: Scenario) -> None:
    facts: list[Fact] = with_motions(pair_of_arms("", 1, 10, 20), scenario)
    rows = curves_csv(facts, {0: "fl", 42: "maml"}, Energy()).rows
    assert {tuple(row[place] for place in (4, 5, 7, 8)) for row in rows} == {(None,) * 4}
    last = [row for row in rows if row[0] == "joules"][39]
    assert last[1:4:2] == (0, 1.0)
