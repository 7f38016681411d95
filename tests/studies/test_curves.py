"""Curves of a study by hand: what had been spent when each task was learned, and its statistics."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.studies.curves import curves_csv, curves_of, learned_by, mean_reward, rewards_at, to_learn
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import runs_of, with_motions
from tests.studies.made_up import meta_fact, pair_of_arms, task_fact


def spent_by(facts: list[Fact], arm: str, scenario: Scenario, **energy: object) -> dict[str, NDArray[np.float64]]:
    priced = scenario.model_copy(update={"energy": scenario.energy.model_copy(update=energy)})
    return to_learn(runs_of(with_motions(facts, scenario), "", arm).values(), priced)


def test_all_clusters_spend_until_a_task_is_learned(scenario: Scenario) -> None:
    facts = pair_of_arms("", 1, 10, 20)  # 21 to 26 rounds without
    costs = spent_by(facts, "fl", scenario)
    # When task 1 was learned six clusters had done 21 rounds each; at the last 22 to 26 of their own, 21 + ... + 26.
    for what, a_round in {"joules": 260.8, "bits": 89.6e6, "gradients": 40, "motions": 40}.items():
        assert costs[what][0, [0, 5]] == pytest.approx([6 * 21 * a_round, 141 * a_round]), what
    # With a stage before: 42 rounds of 3 robots x 20 motions and 60 batches, and 11 rounds of six clusters.
    with_it = spent_by(facts, "maml", scenario)
    assert with_it["motions"][0, 0] == 42 * 60 + 66 * 40
    assert with_it["gradients"][0, 0] == 42 * 60 + 66 * 40


def test_seconds_are_those_of_the_slowest_cluster_by_equal_parts_of_the_sums(scenario: Scenario) -> None:
    # A robot's round: 20 batches of 0.4 s and 20 motions of 0.1 s; then two messages of 5.6 MB, one after the other,
    # at 1 Mbit/s. Clusters wait for nobody: after 21 and 26 rounds.
    rates = {"sl_bit_per_s": 1e6, "ul_bit_per_s": 1e7, "motion_s": 0.1}
    facts = [
        fact.model_copy(update={"evaluation_motions": 0}) if fact.task else fact for fact in pair_of_arms("", 1, 10, 20)
    ]
    costs = spent_by(facts, "fl", scenario, **rates)
    a_round = 20 * 0.4 + 20 * 0.1 + 2 * 44.8
    assert costs["seconds"][0, [0, 5]] == pytest.approx([21 * a_round, 26 * a_round])
    # The stage: 42 rounds of a training robot's 20 motions and its 24.6 MB at 10 Mbit/s, tasks side by side, then 60
    # batches of 0.02 s; and 5.6 MB to each of a cluster's two robots.
    stage = 42 * (20 * 0.1 + 19.68 + 60 * 0.02) + 2 * 4.48
    assert spent_by(facts, "maml", scenario, **rates)["seconds"][0, 0] == pytest.approx(stage + 11 * a_round)


def test_seconds_need_rates_of_the_links_and_what_evaluation_took(scenario: Scenario) -> None:
    facts = pair_of_arms("", 1, 10, 20)
    for energy in ({}, {"ul_bit_per_s": 1e7}, {"sl_bit_per_s": 1e6, "motion_s": 0.1}):
        assert np.isnan(spent_by(facts, "fl", scenario, **energy)["seconds"]).all(), energy
    assert not np.isnan(spent_by(facts, "fl", scenario, sl_bit_per_s=1e6)["seconds"]).any()
    # By an arm of which they are not known nothing is told: with transfer more than sidelinks carry.
    energy = scenario.energy.model_copy(update={"sl_bit_per_s": 1e6})
    found = curves_of(with_motions(facts, scenario), scenario.model_copy(update={"energy": energy}))
    assert [arm.arm for arm in found["seconds"].arms] == ["fl"]
    assert [arm.arm for arm in found["joules"].arms] == ["fl", "maml"]
    assert set(curves_of(with_motions(facts, scenario), scenario)) == {"joules", "bits", "gradients", "motions"}


def test_a_task_solved_before_its_first_round_is_learned_once_the_stage_is_paid(scenario: Scenario) -> None:
    maml = Arm("maml", "maml", 42)
    facts = [meta_fact(maml), task_fact(maml, 1, 0, rounds_first=0), task_fact(maml, 2, 3)]
    (joules,) = spent_by(facts, "maml", scenario)["joules"]
    # 42 rounds of 60 batches of 19.706 J and 3 x 24.6 MB up at 200 kb/J, and 12 x 5.6 MB down.
    stage_j = 42 * (60 * 19.706 + 2952) + 2688
    assert joules == pytest.approx([stage_j, stage_j + 3 * 260.8])


def test_a_task_that_was_not_learned_is_never_reached(scenario: Scenario) -> None:
    facts = [fact.model_copy(update={"learned": fact.task != 2}) for fact in pair_of_arms("", 1, 10, 20)]
    assert np.isinf(spent_by(facts, "fl", scenario)["joules"]).tolist() == [[False, True, *[False] * 4]]


def test_share_and_interquartile_mean_of_tasks_learned() -> None:
    costs = np.array([[1.0, 2.0], [1.0, 3.0], [1.0, 4.0], [1.0, math.inf]])  # 4 seeds x 2 tasks
    share, iqm = learned_by(costs, np.array([0.5, 1.0, 2.0, 4.0]))
    assert share[0].tolist() == [0, 4 / 8, 5 / 8, 7 / 8]
    # Of eight scores two are cut at each end: of the middle four 2, 3 and 4 are ones.
    assert iqm[0].tolist() == [0, 2 / 4, 3 / 4, 1]
    # At budget 1 all seeds have task 1 and none task 2: drawing seeds again within each task changes nothing.
    assert share[1:, 1].tolist() == iqm[1:, 1].tolist() == [0.5, 0.5]
    # At budget 2 one of task 2's four seeds is learned: drawn 0 to 3 times in more than 95% of draws.
    assert share[1:, 2].tolist() == [4 / 8, 7 / 8]


def test_r_by_what_was_spent_is_the_last_one_before_it_and_none_before_the_stage_is_paid(scenario: Scenario) -> None:
    maml, plain = Arm("maml", "maml", 42), Arm("fl", "fl", 0)
    run = [task_fact(plain, 1, 1, rewards="-9 55"), task_fact(plain, 2, 2, rewards="-8 7 60.5")]
    # A round of both clusters is 80 gradients, the second one that of task 2 alone 40.
    budgets = np.array([0.0, 79.0, 80.0, 119.0, 120.0, 1e9])
    (found,) = rewards_at([run], scenario, "gradients", budgets)
    assert found.tolist() == [[-9, -9, 55, 55, 55, 55], [-8, -8, 7, 7, 60.5, 60.5]]
    staged = [meta_fact(maml), task_fact(maml, 1, 0, rewards="52"), task_fact(maml, 2, 1, rewards="-8 51")]
    (found,) = rewards_at([staged], scenario, "gradients", np.array([42 * 60 - 1.0, 42 * 60.0, 42 * 60 + 40.0]))
    assert np.isnan(found[:, 0]).all()
    assert found[:, 1:].tolist() == [[52, 52], [-8, 51]]
    assert np.isnan(rewards_at([pair_of_arms("", 1, 10, 20)[7:]], scenario, "gradients", budgets)).all()  # not noted


def test_the_interquartile_mean_of_r() -> None:
    rewards = np.array([[[1.0, 5.0], [2.0, 5.0]], [[3.0, 5.0], [100.0, math.nan]]])  # 2 seeds x 2 tasks x 2 budgets
    found = mean_reward(rewards)
    assert found[0, 0] == (2 + 3) / 2
    # Of each task its two seeds are drawn again: with 1 and 1, 2 and 2 to 3 and 3, 100 and 100, a sixteenth of draws.
    assert found[1:, 0].tolist() == [(1 + 2) / 2, (3 + 100) / 2]
    assert np.isnan(found[:, 1]).all()


def test_one_seed_has_no_interval(scenario: Scenario) -> None:
    rows = curves_csv(curves_of(with_motions(pair_of_arms("", 1, 10, 20), scenario), scenario)).rows
    assert {tuple(row[place] for place in (6, 7, 9, 10, 11, 12, 13)) for row in rows} == {(None,) * 7}
    last = [row for row in rows if row[0] == "joules"][39]
    assert (last[1:4], last[5]) == (("", "fl", 0), 1.0)
