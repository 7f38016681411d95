"""The measured beta in the bill."""

from __future__ import annotations

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.energy.bill import Bill
from jouleswarm.energy.facts import STAGE, Counts, Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.literal import price as cost_of
from jouleswarm.energy.prices import price
from jouleswarm.runs.answer import answer_of
from jouleswarm.runs.arm_facts import arm_facts
from jouleswarm.runs.beta import measured_beta
from jouleswarm.runs.facts import TaskResult
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.prices import facts_of

MEASURED = Energy(beta="measured")
# 10 + 10 gradients in the data center
PARTS = {("ml", STAGE): Counts(gradients_support=10, gradients_query=10)}


def row(arm: str, beta: float | None, round_: int = 1) -> RoundRow:
    return RoundRow(phase="maml", arm=arm, task=1, agent=0, round=round_, gradients=20, beta=beta, seconds=1.0)


def priced(energy: Energy, beta: float | None) -> Bill | None:
    return price(literal, Facts("maml-t42", "maml", t0=42, parts=PARTS, beta=beta), energy)  # type: ignore[arg-type]


def test_a_number_stays_whatever_was_measured() -> None:
    # gamma (10 + 1.5 x 10) P_0 T_0 = 1.67 x 25 x 11.8 J
    bill = priced(Energy(beta=1.5), 3.0)
    assert bill is not None
    assert bill.total_j == pytest.approx(492.65)


def test_the_measured_beta_prices_the_query_gradients() -> None:
    assert measured_beta([row("maml", 2.0), row("maml", 4.0, 2), row("anil", 9.0)], "maml", exact=True) == 3.0
    # gamma (10 + 3 x 10) P_0 T_0 = 1.67 x 40 x 11.8 J
    bill = priced(MEASURED, 3.0)
    assert bill is not None
    assert bill.total_j == pytest.approx(788.24)


def test_a_method_without_gradient_through_gradient_has_beta_1() -> None:
    assert measured_beta([row("fomaml", None)], "fomaml", exact=False) == 1.0
    assert measured_beta([], "fl", exact=False) == 1.0


def test_a_number_for_beta_is_no_price_of_a_method_of_first_order() -> None:
    first_order = Facts("fomaml-t42", "fomaml", t0=42, parts=PARTS, exact=False)  # type: ignore[arg-type]
    bills = [price(literal, first_order, Energy(beta=beta)) for beta in (1.0, 2.63, "measured")]
    # gamma (10 + 10) P_0 T_0 = 1.67 x 20 x 11.8 J, where exact MAML pays 1.67 x (10 + 26.3) x 11.8 J
    assert [bill and bill.total_j for bill in bills] == pytest.approx([394.12] * 3)
    exact = priced(Energy(beta=2.63), None)
    assert exact is not None
    assert exact.total_j == pytest.approx(715.3278)


def test_a_run_s_arms_are_exact_as_their_methods_say() -> None:
    scenario = load_scenario("toy", ['methods=["maml", "fomaml", "fl"]'])
    exact = {arm.name: arm_facts(scenario, [], [], arm.name).exact for arm in scenario.arms}
    assert exact == {"maml": True, "fomaml": False, "fl": False}


@pytest.mark.parametrize(("method", "kept", "exact"), [
    ("maml", None, True), ("maml", 1.0, True), ("fomaml", None, False), ("theirs", 1.0, False), ("theirs", 2.0, True),
    ("theirs", None, True),
])  # fmt: skip
def test_of_a_study_s_facts_the_method_says_so_or_of_a_user_s_the_beta_that_is_kept(
    method: str, kept: float | None, exact: bool
) -> None:
    counts = dict.fromkeys((each for each in Fact.model_fields if each.startswith(("gradients", "rounds_"))), 10)
    moved = dict.fromkeys(("uplink_bytes", "downlink_bytes", "sidelink_bytes", "sidelink_sent_bytes", "seconds"), 0)
    told = {"variant": "", "arm": method, "method": method, "reward": None, "rmse_m": None, "learned": True}
    told |= {"seed": 1, "t0": 42, "task": 0, "robots": 0, "links": 0, "rounds": 42, "beta": kept} | counts | moved
    facts = Fact.model_validate(told)
    assert facts_of([facts]).exact is exact


def test_a_run_that_did_not_measure_says_how_to() -> None:
    assert measured_beta([row("maml", None)], "maml", exact=True) is None
    with pytest.raises(ConfigurationError, match=r"beta of maml was not measured .* energy\.beta=measured"):
        priced(MEASURED, None)


def test_a_beta_still_to_be_measured_has_no_price() -> None:
    with pytest.raises(ConfigurationError, match='beta is "measured", expected a number'):
        cost_of(Counts(gradients_query=1), MEASURED)


def test_where_a_first_order_arm_is_held_against_an_exact_one_each_has_its_own_beta() -> None:
    scenario = load_scenario("toy", ['methods=["maml", "fomaml"]', "energy.beta=2"])
    moved = {**PARTS, ("fl", 1): Counts(sidelink_bytes=6_250_000, sidelink_sent_bytes=6_250_000)}
    facts = {
        "maml": Facts("maml", "maml", 42, PARTS, {1: 1}),  # type: ignore[arg-type]
        "fomaml": Facts("fomaml", "fomaml", 42, moved, {1: 1}, exact=False),  # type: ignore[arg-type]
    }
    learned = [TaskResult(task=1, rounds=1, reward=60.0, rmse_m=0.0, learned=True, robot_rounds=2)]
    (held,) = answer_of(scenario, facts, dict.fromkeys(facts, learned), scenario.energy, [literal]).against
    # 1.67 (10 + 10) 11.8 + 50 Mbit / 500 kb/J = 394.12 + 100 J, against 1.67 (10 + 2 x 10) 11.8 = 591.18 J
    assert (held.arm, held.other, held.factor) == ("fomaml", "maml", pytest.approx(494.12 / 591.18))
    # the same where 50 Mbit cost 591.18 - 394.12 J
    assert held.turns_at == {"sl_bit_per_j": pytest.approx(50e6 / 197.06)}
