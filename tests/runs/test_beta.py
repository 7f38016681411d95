"""The measured beta in the bill."""

from __future__ import annotations

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.sections import Energy
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.energy.bill import Counts
from jouleswarm.energy.equations import price
from jouleswarm.runs.beta import with_beta

MEASURED = Energy(beta="measured")


def row(arm: str, beta: float | None, round_: int = 1) -> RoundRow:
    return RoundRow(phase="maml", arm=arm, task=1, agent=0, round=round_, gradients=20, beta=beta, seconds=1.0)


def test_a_number_stays_whatever_was_measured() -> None:
    assert with_beta(Energy(beta=1.5), [row("maml", 3.0)], "maml").beta == 1.5


def test_the_measured_beta_prices_the_query_gradients() -> None:
    energy = with_beta(MEASURED, [row("maml", 3.0), row("maml", 3.0, 2), row("anil", 9.0)], "maml-t42")
    # gamma (10 + 3 x 10) P_0 T_0 = 1.67 x 40 x 11.8 J
    assert price(Counts(gradients_support=10, gradients_query=10), energy).total_j == pytest.approx(788.24)


def test_a_method_without_gradient_through_gradient_has_beta_1() -> None:
    assert with_beta(MEASURED, [row("fomaml", None)], "fomaml").beta == 1.0
    assert with_beta(MEASURED, [], "fl").beta == 1.0


def test_a_run_that_did_not_measure_says_how_to() -> None:
    with pytest.raises(ConfigurationError, match=r"beta of maml was not measured .* energy\.beta=measured"):
        with_beta(MEASURED, [row("maml", None)], "maml")


def test_a_beta_still_to_be_measured_has_no_price() -> None:
    with pytest.raises(ConfigurationError, match='beta is "measured", expected a number'):
        price(Counts(gradients_query=1), MEASURED)
