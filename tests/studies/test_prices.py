"""Joules of facts, by hand: one joule a byte and a gradient."""

import pytest

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.sections import Energy
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import PAIRS, Causes, causes, failures, moved_bytes, priced, runs_of
from tests.studies.made_up import meta_fact, task_fact

ONES = Energy(p0_w=1, t0_batch_s=1, pk_w=1, tk_batch_s=1, pue=1, ul_bit_per_j=8, sl_bit_per_j=8)
MAML = Arm("maml", "maml", 2)


def small_run(seed: int = 1) -> list[Fact]:
    return [
        meta_fact(MAML, seed, gradients_support=3, gradients_query=4, uplink_bytes=50, downlink_bytes=6),
        task_fact(MAML, 1, 5, seed, gradients_robots=10, sidelink_bytes=20, sidelink_sent_bytes=20),
        task_fact(MAML, 2, 7, seed, gradients_robots=30, sidelink_bytes=40, sidelink_sent_bytes=40, learned=False),
    ]


def test_literal_prices_tell_stages_and_causes_apart() -> None:
    found = priced(small_run(), ONES, "literal")
    assert found is not None
    assert found.meta == (7, 56, 63)
    assert found.tasks == {1: (10, 20, 30), 2: (30, 40, 70)}
    assert (found.tasks_j, found.total_j) == (100, 163)


def test_causes_add_up_to_the_total() -> None:
    found = causes(small_run(), ONES)
    assert found == Causes(center_j=7, robots_j=40, uplink_j=50, downlink_j=6, sidelink_j=60)
    assert found.total_j == 163


def test_published_prices_know_rounds_only() -> None:
    found = priced(small_run(), PAIRS[0].of(Energy()), "published")
    assert found is not None
    assert found.meta == (None, None, pytest.approx(704.8))  # 2 x 352.4
    assert found.tasks_j == pytest.approx(12 * 246.3)


def test_published_prices_are_not_defined_at_the_other_pair() -> None:
    assert priced(small_run(), PAIRS[1].of(Energy()), "published") is None


def test_an_arm_without_meta_learning_has_a_stage_that_costs_nothing() -> None:
    plain = Arm("fl", "fl", 0)
    for prices in ("literal", "published"):
        found = priced([task_fact(plain, 1, 3)], Energy(), prices)
        assert found is not None
        assert found.meta.total_j == 0
        assert found.total_j > 0


def test_runs_are_told_apart_by_seed_variant_and_arm() -> None:
    other = task_fact(Arm("fl", "fl", 0), 1, 3)
    facts = [*small_run(2), *small_run(1), other, task_fact(MAML, 1, 3, variant="Q=1")]
    assert runs_of(facts, "", "maml") == {1: small_run(1), 2: small_run(2)}


def test_failures_and_bytes_are_counted() -> None:
    assert failures(small_run()) == 1
    assert moved_bytes(small_run()) == 116
