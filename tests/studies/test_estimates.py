"""Means and intervals, worked out by hand."""

import pytest

from jouleswarm.common.errors import StudyError
from jouleswarm.studies.estimates import estimate


def test_the_interval_of_three_seeds_is_students() -> None:
    # s of 1, 2, 3 is 1; t(0.975, 2) = 4.3027; 4.3027 x 1 / sqrt(3) = 2.4842
    found = estimate([1, 2, 3])
    assert found.mean == 2
    assert found.ci95 == pytest.approx(2.4842, abs=1e-4)
    assert found.n == 3


def test_two_seeds_have_the_wide_interval_of_one_degree_of_freedom() -> None:
    # s of 0 and 2 is sqrt 2; t(0.975, 1) = 12.7062; 12.7062 x sqrt 2 / sqrt 2
    assert estimate([0, 2]).ci95 == pytest.approx(12.7062, abs=1e-4)


def test_one_seed_has_no_interval() -> None:
    assert estimate([7.5]) == (7.5, None, 1, ())
    assert estimate([7.5]).drawn_ci95 == 0


def test_three_seeds_are_drawn_as_points_and_four_as_an_interval() -> None:
    assert (estimate([1, 2, 6]).singles, estimate([1, 2, 6]).drawn_ci95) == ((1, 2, 6), 0)
    four = estimate([1, 2, 6, 7])
    assert (four.singles, four.drawn_ci95) == ((), four.ci95)
    assert estimate([1000, 3000]).scaled(1e-3).singles == (1, 3)


def test_a_mean_of_nothing_is_refused() -> None:
    with pytest.raises(StudyError, match="no values"):
        estimate([])
