"""What a study's verdict hangs on, by hand: Table I's batches and bytes as in `test_breakeven`."""

from __future__ import annotations

import pytest

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.studies.breakeven import compared
from jouleswarm.studies.why import why_csv, why_figure, why_markdown
from tests.studies.made_up import pair_of_arms

ARM = compared(pair_of_arms("", 1, 10, 30), "maml", "fl", (1, 2, 6))
UP_J, SIDE_J, ROBOT_J, CENTER_J = 42 * 2952 + 2688, 81 * 179.2, 81 * 81.6, 42 * 1182.36


def test_elasticities_are_shares_and_break_even_moves_with_each_constant() -> None:
    rows = {row[1]: row for row in why_csv([ARM], Energy()).rows}
    total_j = UP_J + SIDE_J + ROBOT_J + CENTER_J
    shares = {"ul_bit_per_j": -UP_J, "sl_bit_per_j": -SIDE_J, "tk_batch_s": ROBOT_J, "pue": CENTER_J}
    for constant, joules in shares.items():
        assert rows[constant][3] == pytest.approx(joules / total_j, rel=1e-4)
    # M*: 123,984 + 49,659.12 J over 20 rounds of 260.8 J less 448 J; with gamma doubled 49,659.12 J more.
    saved_j = 20 * 260.8 - 448
    assert rows["pue"][5:] == pytest.approx([(123_984 + part * 49_659.12) / saved_j for part in (0.5, 1, 2)])


def test_where_the_verdict_turns() -> None:
    rows = {row[1]: row for row in why_csv([ARM], Energy()).rows}
    # 120 rounds more without: T_k at which their batches pay for the rest; 120 x 40 x 5.1 W x T_k.
    rest_j = UP_J + CENTER_J - 120 * 179.2
    assert rows["tk_batch_s"][4] == pytest.approx(rest_j / (120 * 40 * 5.1), rel=1e-6)


def test_readers_have_a_table_an_arm_and_a_figure() -> None:
    (table,) = why_markdown([ARM], Energy())
    assert table.title == "What the bill hangs on: t0 = 42 against without"
    (axes,) = why_figure(ARM, Energy()).axes
    assert {text.get_text().strip() for text in axes.texts} == {
        "P_0",
        "T_0",
        "P_k",
        "T_k",
        "gamma",
        "beta",
        "E_UL",
        "E_SL",
    }
