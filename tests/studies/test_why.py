"""What a study's verdict hangs on, by hand: Table I's batches and bytes as in `test_breakeven`."""

from __future__ import annotations

import pytest

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.studies.breakeven import compared
from jouleswarm.studies.prices import with_motions
from jouleswarm.studies.why import against_plain, why_csv, why_figures, why_markdown
from tests.studies.made_up import meta_fact, pair_of_arms, task_fact

ARM = compared(pair_of_arms("", 1, 10, 30), "maml", "fl", (1, 2, 6))
UP_J, SIDE_J, ROBOT_J, CENTER_J = 42 * 2952 + 2688, 81 * 179.2, 81 * 81.6, 42 * 1182.36


def test_elasticities_are_shares_and_break_even_moves_with_each_constant() -> None:
    rows = {row[3]: row for row in why_csv([ARM], Energy()).rows}
    total_j = UP_J + SIDE_J + ROBOT_J + CENTER_J
    shares = {"ul_bit_per_j": -UP_J, "sl_bit_per_j": -SIDE_J, "tk_batch_s": ROBOT_J, "pue": CENTER_J}
    for constant, joules in shares.items():
        assert rows[constant][5] == pytest.approx(joules / total_j, rel=1e-4)
    # M*: 123,984 + 49,659.12 J over 20 rounds of 260.8 J less 448 J; with gamma doubled 49,659.12 J more.
    saved_j = 20 * 260.8 - 448
    assert rows["pue"][7:] == pytest.approx([(123_984 + part * 49_659.12) / saved_j for part in (0.5, 1, 2)])


def test_where_the_verdict_turns() -> None:
    rows = {row[3]: row for row in why_csv([ARM], Energy()).rows}
    # 120 rounds more without: T_k at which their batches pay for the rest; 120 x 40 x 5.1 W x T_k.
    rest_j = UP_J + CENTER_J - 120 * 179.2
    assert rows["tk_batch_s"][6] == pytest.approx(rest_j / (120 * 40 * 5.1), rel=1e-6)


def test_readers_have_a_table_an_arm_and_a_figure() -> None:
    (table,) = why_markdown([ARM], Energy())
    assert table.title == "What the bill hangs on: t0 = 42 against without"
    (axes,) = why_figures([ARM], Energy())["why"]().axes
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


def test_every_arm_of_every_variant_is_held_against_the_one_without(scenario: Scenario) -> None:
    other, isolated = Arm("maml", "maml", 42), Arm("isolated", "isolated", 0)
    half = {"gradients_support": 42 * 20, "gradients_query": 42 * 20, "uplink_bytes": 1.0}  # two training robots
    facts = [
        *pair_of_arms("base", 1, 10, 30),
        *(task_fact(isolated, task, 5, variant="base", sidelink_bytes=0) for task in range(1, 7)),
        meta_fact(other, 1, "Q=2", **half),
        *(fact for fact in pair_of_arms("Q=2", 1, 10, 30) if fact.task),
        meta_fact(other, 1, "alone"),
        *(task_fact(other, task, 5, variant="alone") for task in range(1, 7)),
    ]
    pairs = against_plain(with_motions(facts, scenario), scenario)
    assert [(each.variant, each.arm, tuple(each.seen)) for each in pairs] == [
        ("base", "isolated", ()), ("base", "maml", (1, 2, 6)), ("Q=2", "maml", ()),
    ]  # fmt: skip
    titles = [table.title.removeprefix("What the bill hangs on: ") for table in why_markdown(pairs, Energy())]
    assert titles == ["base, isolated against fl", "base, maml against fl", "Q=2, t0 = 42 against without"]
    told = {
        (row[0], row[1]): row[7:] for row in why_csv(pairs, Energy()).rows if row[3] == "pue" or row[1] == "isolated"
    }
    assert told["base", "isolated"] == told["Q=2", "maml"] == (None, None, None)
    assert told["base", "maml"] == pytest.approx(
        next(row[7:] for row in why_csv([ARM], Energy()).rows if row[3] == "pue")
    )


def test_where_no_arm_ever_pays_there_is_no_figure() -> None:
    assert why_figures([compared(pair_of_arms("", 1, 30, 20), "maml", "fl", (1, 2, 6))], Energy()) == {}
