"""Joules of facts, by hand: one joule a byte and a gradient."""

import pytest

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import CAUSES, Bill, Cost, parts
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.published import published
from jouleswarm.studies.columns import total_column
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import (
    PAIRS,
    cost_of,
    facts_of,
    failures,
    moved_bytes,
    priced,
    runs_of,
)
from tests.studies.made_up import meta_fact, task_fact

ONES = Energy(p0_w=1, t0_batch_s=1, pk_w=1, tk_batch_s=1, pue=1, ul_bit_per_j=8, sl_bit_per_j=8)
MAML = Arm("maml", "maml", 2)


def small_run(seed: int = 1) -> list[Fact]:
    return [
        meta_fact(MAML, seed, gradients_support=3, gradients_query=4, uplink_bytes=50, downlink_bytes=6),
        task_fact(MAML, 1, 5, seed, gradients_robots=10, sidelink_bytes=20, sidelink_sent_bytes=20),
        task_fact(MAML, 2, 7, seed, gradients_robots=30, sidelink_bytes=40, sidelink_sent_bytes=40, learned=False),
    ]


def test_literal_prices_tell_phases_tasks_and_causes_apart() -> None:
    found = priced(small_run(), ONES, literal)
    assert found is not None
    assert (found.ml.learning_j, found.ml.communication_j, found.ml.total_j) == (7, 56, 63)
    assert (found.fl.learning_j, found.fl.communication_j, found.total_j) == (40, 60, 163)
    second = literal.price(facts_of(small_run()).of_task(2), ONES)
    assert (second.ml.total_j, second.fl.learning_j, second.fl.communication_j) == (0, 30, 40)


def test_causes_add_up_to_the_total() -> None:
    found = cost_of(small_run(), ONES)
    assert [found.by_cause[cause] for cause in CAUSES] == [7, 40, 50, 6, 60, 0, 0, 0, 0]
    assert found.total_j == 163


def test_published_prices_know_rounds_only() -> None:
    found = priced(small_run(), PAIRS[0].of(Energy()), published)
    assert found is not None
    assert found.ml.total_j == pytest.approx(704.8)  # 2 x 352.4
    assert found.fl.total_j == pytest.approx(12 * 246.3)
    assert set(parts(found).values()) == {None, found.ml.total_j, found.fl.total_j, found.total_j}


def test_published_prices_are_not_defined_at_the_other_pair() -> None:
    assert priced(small_run(), PAIRS[1].of(Energy()), published) is None


def test_published_prices_are_of_pairs_of_neighbours() -> None:
    here = PAIRS[0].of(Energy())
    assert priced([fact.model_copy(update={"robots": 3}) for fact in small_run()], here, published) is None
    assert priced([fact.model_copy(update={"links": 0}) for fact in small_run()], here, published) is None


def test_an_arm_without_meta_learning_has_a_phase_that_costs_nothing() -> None:
    plain = Arm("fl", "fl", 0)
    for prices in (literal, published):
        found = priced([task_fact(plain, 1, 3)], Energy(), prices)
        assert found is not None
        assert found.ml.total_j == 0
        assert found.total_j > 0


class ByMessage:
    name, label = "by_message", "a joule a message"

    def price(self, facts: Facts, energy: Energy) -> Bill:
        return Bill(fl=Cost(uplink_j=sum(flow.messages for flow in facts.flows)))


def test_a_list_that_asks_for_more_than_facts_csv_holds_has_no_bill() -> None:
    assert priced(small_run(), ONES, ByMessage()) is None
    assert total_column(ByMessage(), ONES, "E").over([*small_run(), *small_run(2)], "", "maml") is None


def test_runs_are_told_apart_by_seed_variant_and_arm() -> None:
    other = task_fact(Arm("fl", "fl", 0), 1, 3)
    facts = [*small_run(2), *small_run(1), other, task_fact(MAML, 1, 3, variant="Q=1")]
    assert runs_of(facts, "", "maml") == {1: small_run(1), 2: small_run(2)}


def test_failures_and_bytes_are_counted() -> None:
    assert failures(small_run()) == 1
    assert moved_bytes(small_run()) == 116
