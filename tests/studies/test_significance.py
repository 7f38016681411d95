"""Ratios over seeds, the paired test and Holm's correction."""

from __future__ import annotations

import math

import pytest
from scipy.stats import wilcoxon

from jouleswarm.studies.significance import holm, paired_p, ratios


def test_the_ratio_of_means_and_the_mean_of_ratios_are_told_apart() -> None:
    found = ratios([10, 30], [5, 5])
    assert (found.of_means.value, found.mean.value) == (4, 4)
    found = ratios([10, 30], [10, 5])
    assert (found.of_means.value, found.mean.value) == (pytest.approx(40 / 15), 3.5)
    # Of two seeds drawn again a quarter are the first one twice, a quarter the second one twice.
    assert (found.of_means.low, found.of_means.high) == (1, 6)


def test_one_seed_has_a_ratio_and_no_interval() -> None:
    assert ratios([3], [2]).of_means == (1.5, None, None)


def test_a_task_that_took_no_round_makes_an_infinite_ratio_and_nothing_over_nothing_is_one() -> None:
    assert ratios([4, 0], [0, 0]).mean.value == math.inf
    assert ratios([0, 0], [0, 0]).of_means == (1, 1, 1)


def test_the_paired_test_counts_all_ways_to_set_signs() -> None:
    assert paired_p([1, 2, 3], [0, 0, 0]) == 0.25  # 2 of 8 ways are as far apart
    # Differences 1, 1, 4, -2 have ranks 1.5, 1.5, 4 and 3: the negative ones sum up to 3, as or less in 5 of 16 ways.
    assert paired_p([2, 2, 5, 0], [1, 1, 1, 2]) == 2 * 5 / 16
    assert paired_p([1, 1], [1, 1]) == 1
    assert paired_p([1], [0]) is None


def test_without_ties_it_is_scipys_exact_test() -> None:
    apart = [3.0, -1.0, 4.0, -5.0, 9.0, 2.0, -6.0, 7.5]
    assert paired_p(apart, [0] * 8) == pytest.approx(wilcoxon(apart, method="exact").pvalue)


def test_holm_multiplies_the_smallest_by_all_and_never_falls() -> None:
    # 0.01 x 3; 0.03 x 2; 0.04 x 1, but no less than the one before.
    assert holm([0.04, None, 0.01, 0.03]) == pytest.approx([0.06, None, 0.03, 0.06])
    assert holm([0.6, 0.7]) == [1, 1]
