"""The measured beta in the bill."""

from __future__ import annotations

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.energy.bill import Bill
from jouleswarm.energy.facts import STAGE, Counts, Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.literal import price as cost_of
from jouleswarm.energy.prices import price
from jouleswarm.runs.beta import measured_beta

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
    assert measured_beta([row("maml", 2.0), row("maml", 4.0, 2), row("anil", 9.0)], "maml") == 3.0
    # gamma (10 + 3 x 10) P_0 T_0 = 1.67 x 40 x 11.8 J
    bill = priced(MEASURED, 3.0)
    assert bill is not None
    assert bill.total_j == pytest.approx(788.24)


def test_a_method_without_gradient_through_gradient_has_beta_1() -> None:
    assert measured_beta([row("fomaml", None)], "fomaml") == 1.0
    assert measured_beta([], "fl") == 1.0


def test_a_run_that_did_not_measure_says_how_to() -> None:
    assert measured_beta([row("maml", None)], "maml") is None
    with pytest.raises(ConfigurationError, match=r"beta of maml was not measured .* energy\.beta=measured"):
        priced(MEASURED, None)


def test_a_beta_still_to_be_measured_has_no_price() -> None:
    with pytest.raises(ConfigurationError, match='beta is "measured", expected a number'):
        cost_of(Counts(gradients_query=1), MEASURED)
