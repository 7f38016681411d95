"""Break-even of a study by hand: Table I's batches and bytes, so that a cluster's round costs 260.8 J.

40 batches of 2.04 J and 2 x 5.6 MB at 500 kb/J. The stage of 42 rounds: 2520 batches of 19.706 J and 3 x 24.6 MB a
round at 200 kb/J, 173,643.12 J; then 448 J down to the two robots of a task.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from jouleswarm.common.errors import StudyError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.breakeven import Savings, returns_to_pay, tasks_to_pay
from jouleswarm.energy.published import published
from jouleswarm.studies.breakeven import at_papers_sizes, compared, gain_map
from jouleswarm.studies.facts import Fact
from tests.studies.made_up import pair_of_arms

STAGE_J, ROUND_J, DOWN_J = 173_643.12, 260.8, 448.0
SEEN = (1, 2, 6)


def _facts(**rounds: int) -> list[Fact]:
    """Seed -> rounds that a task takes more without than with."""
    return [fact for seed, saved in rounds.items() for fact in pair_of_arms("", int(seed[1:]), 10, 10 + saved)]


def test_what_a_task_saves_is_its_rounds_less_what_went_down() -> None:
    found = compared(_facts(s1=20), "maml", "fl", SEEN).means(Energy())
    saved_j = 20 * ROUND_J - DOWN_J
    assert found == pytest.approx(Savings(STAGE_J, saved_j, saved_j, 3, (30 + 3.5) * ROUND_J))
    assert tasks_to_pay(found) == pytest.approx(STAGE_J / saved_j)
    assert returns_to_pay(found) == pytest.approx(STAGE_J / saved_j)


def test_the_interval_is_over_seeds_drawn_again() -> None:
    found = compared(_facts(s1=20, s2=30), "maml", "fl", SEEN)
    # of two seeds a quarter of the draws has the first twice, a quarter the second
    bounds = [STAGE_J / (saved * ROUND_J - DOWN_J) for saved in (30, 20)]
    assert found.between(tasks_to_pay, Energy()) == pytest.approx(bounds)
    assert compared(_facts(s1=20), "maml", "fl", SEEN).between(tasks_to_pay, Energy()) is None


def test_an_interval_may_end_in_never() -> None:
    found = compared(_facts(s1=20, s2=-9), "maml", "fl", SEEN)
    low, high = found.between(tasks_to_pay, Energy()) or (0.0, 0.0)
    assert (low, high) == (pytest.approx(STAGE_J / (20 * ROUND_J - DOWN_J)), math.inf)


def test_published_prices_count_rounds_alone_and_are_not_made_up() -> None:
    found = compared(_facts(s1=20), "maml", "fl", SEEN)
    means = found.means(Energy(), published)
    assert means is not None
    assert tasks_to_pay(means) == pytest.approx(42 * 352.4 / (20 * 246.3))
    assert found.means(Energy(ul_bit_per_j=500e3, sl_bit_per_j=200e3), published) is None
    assert found.between(tasks_to_pay, Energy(ul_bit_per_j=500e3), published) is None


def test_at_the_papers_sizes_another_network_costs_the_same() -> None:
    small = [
        fact.model_copy(
            update={"sidelink_bytes": 5.0, "sidelink_sent_bytes": 5.0} if fact.task else {"uplink_bytes": 7.0}
        )
        for fact in _facts(s1=20)
    ]
    assert at_papers_sizes(small, training_robots=3) == _facts(s1=20)


def test_the_map_takes_the_best_candidate_at_each_point() -> None:
    short = [fact for fact in _facts(s1=20) if fact.t0 == 0 or fact.task == 0]
    short += [
        fact.model_copy(update={"t0": 42}) for fact in pair_of_arms("", 1, 10, 30) if fact.arm == "maml" and fact.task
    ]
    one = compared(short, "maml", "fl", SEEN)
    found = gain_map([one, one], Energy(), np.array([1.0, 100.0]), np.array([0.4, 4.0]))
    plain_j, saved_j = 33.5 * ROUND_J, 20 * ROUND_J - DOWN_J
    assert found[0] == pytest.approx([m * plain_j / (STAGE_J + m * (plain_j - saved_j)) for m in (1, 100)])
    # the uplink ten times as efficient: 12,398.4 J of it in place of 123,984, 44.8 J down
    cheap_j, cheaper_j = STAGE_J - 0.9 * 123_984, saved_j + 0.9 * DOWN_J
    assert found[1] == pytest.approx([m * plain_j / (cheap_j + m * (plain_j - cheaper_j)) for m in (1, 100)])


def test_an_arm_without_facts_or_seeds_in_common_is_named() -> None:
    with pytest.raises(StudyError, match="0 runs of maml-t66 with a stage and 1 of fl, expected some of each"):
        compared(_facts(s1=20), "maml-t66", "fl", SEEN)
