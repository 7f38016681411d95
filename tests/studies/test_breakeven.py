"""Break-even by hand: all constants 1, so that joules are counts."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jouleswarm.common.errors import StudyError
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.facts import Counts
from jouleswarm.energy.published import published
from jouleswarm.studies.breakeven import Costs, MeanCounts, break_even_tasks, costs, gain, gain_map, mean_counts
from tests.studies.made_up import meta_fact, task_fact

# 8 bit a byte at 8 bit/J: one joule a byte.
ONES = Energy(p0_w=1, t0_batch_s=1, pk_w=1, tk_batch_s=1, pue=1, ul_bit_per_j=8, sl_bit_per_j=8)
MEAN = MeanCounts(
    method="maml",
    t0=42,
    meta=Counts(gradients_support=20, uplink_bytes=100),
    task=Counts(gradients_robots=4, sidelink_bytes=4, downlink_bytes=2),
    plain=Counts(gradients_robots=25, sidelink_bytes=25),
    task_rounds=4,
    plain_rounds=25,
)
MAML, PLAIN = Arm("maml", "maml", 42), Arm("fl", "fl", 0)


def test_costs_are_priced_counts() -> None:
    assert costs(MEAN, ONES) == Costs(meta_j=120, task_j=10, plain_j=50)


def test_meta_learning_pays_once_what_tasks_save_covers_it() -> None:
    # 120 + 10 M = 50 M at M = 3
    assert break_even_tasks(Costs(120, 10, 50)) == 3


@pytest.mark.parametrize("task_j", [50, 60])
def test_where_tasks_save_nothing_no_number_of_them_is_enough(task_j: float) -> None:
    assert break_even_tasks(Costs(120, task_j, 50)) == math.inf


def test_the_gain_is_one_at_break_even() -> None:
    # M = 1: 50 / 130; M = 3: 150 / 150; M = 12: 600 / 240
    assert gain(Costs(120, 10, 50), np.array([1.0, 3.0, 12.0])) == pytest.approx([50 / 130, 1, 2.5])


def test_the_map_takes_the_best_candidate_at_each_point() -> None:
    dear = MeanCounts("maml", 42, Counts(uplink_bytes=1000), Counts(), Counts(gradients_robots=10), 1, 10)
    cheap = MeanCounts(
        "maml", 90, Counts(uplink_bytes=10), Counts(gradients_robots=9), Counts(gradients_robots=10), 9, 10
    )
    found = gain_map([dear, cheap], ONES, np.array([1.0, 1000.0]), np.array([1.0, 10.0]))
    # E_UL = E_SL. M = 1: 10/1000 or 10/19; M = 1000: 10000/1000 or 10000/9010.
    # E_UL ten times that: 10/100 or 10/10; 10000/100 or 10000/9001.
    assert found == pytest.approx(np.array([[10 / 19, 10], [1, 100]]))


def test_what_goes_down_grows_with_the_tasks_and_what_goes_up_does_not() -> None:
    facts = [meta_fact(MAML), *(task_fact(MAML, task, 10) for task in range(1, 7))]
    found = mean_counts(facts, [task_fact(PLAIN, 1, 30), task_fact(PLAIN, 2, 50)])
    assert found.meta == Counts(
        gradients_support=1260, gradients_query=1260, uplink_bytes=3 * 24_600_000 * 42, downlink_bytes=0
    )
    assert found.task.downlink_bytes == 2 * 5_600_000  # 12 robots' over 6 tasks
    assert found.task.gradients_robots == 400
    assert found.plain.gradients_robots == 1600  # the mean of 30 and 50 rounds of 40
    assert (found.task_rounds, found.plain_rounds) == (10, 40)


def test_published_prices_break_even_by_round_numbers() -> None:
    found = costs(MEAN, Energy(), published)
    assert found is not None
    # 42 x 352.4 / ((25 - 4) x 246.3) = 14800.8 / 5172.3
    assert break_even_tasks(found) == pytest.approx(2.86155, rel=1e-5)


def test_published_prices_are_not_made_up_at_other_efficiencies() -> None:
    assert costs(MEAN, Energy(ul_bit_per_j=500e3, sl_bit_per_j=200e3), published) is None


def test_published_prices_are_not_made_up_for_methods_without_its_rounds() -> None:
    assert costs(replace(MEAN, method="centralized", links=0), Energy(), published) is None


def test_an_arm_without_facts_is_named() -> None:
    with pytest.raises(StudyError, match="0 meta-learning stages, 1 tasks with and 0 without"):
        mean_counts([task_fact(MAML, 1, 3)], [])
