"""The audit's figures, worked out by hand from what the paper prints."""

import io

import pytest
from rich.console import Console

from jouleswarm.report.audit import print_audit
from jouleswarm.report.audit_rows import (
    EFFICIENT_SIDELINK,
    EFFICIENT_UPLINK,
    AuditRow,
    audit_rows,
    implied_bill,
    literal_bill,
)
from jouleswarm.runs.paper import BEST_SIDELINK, BEST_UPLINK, HEADLINE, NO_MAML, TABLE_II, printed_total


def row(quantity: str) -> AuditRow:
    (found,) = [each for each in audit_rows() if each.quantity.startswith(quantity)]
    return found


@pytest.mark.parametrize(
    ("t0", "total"), [(0, 921.5), (42, 371.5), (66, 329.8), (90, 306.5), (132, 153.7), (210, 129.2), (240, 104.0)]
)
def test_table_ii_sums(t0: int, total: float) -> None:
    assert sum(TABLE_II[t0]) == pytest.approx(total)


def test_gradients_per_joule_are_three_times_what_is_printed() -> None:
    assert row("E_C of the data center").literal == pytest.approx(0.08475, rel=1e-3)  # 1 / (590 x 0.02)
    assert row("E_C of a robot").literal == pytest.approx(0.4902, rel=1e-3)  # 1 / (5.1 x 0.4)
    assert not row("E_C of the data center").consistent
    assert row("E_C of the data center").verdict == "literal differs by +182%"


def test_rounds_claimed_against_table_ii() -> None:
    without = row("sum of t_i, no MAML")
    assert (without.printed, without.table_ii) == ("910", pytest.approx(921.5))
    assert without.verdict == "Table II differs by +1.3%"
    assert row("sum of t_i, t0 = 240").table_ii == pytest.approx(104.0)
    assert row("t_3 + t_4 + t_5").verdict == "Table II agrees within rounding"
    assert row("t_1 + t_2 + t_6").verdict == "Table II agrees within rounding"


def test_a_maml_round() -> None:
    found = row("one MAML round")
    assert found.literal == pytest.approx(4134.36)  # 1182.36 J + 2952 J
    assert found.published == pytest.approx(352.4)


def test_an_fl_round() -> None:
    found = row("one FL round")
    assert found.literal == pytest.approx(260.8)
    assert found.published == pytest.approx(246.3)
    assert "248.0 J with weights" in found.note  # 81.6 J + 2 x 41.6 Mbit / 500 kb/J = 81.6 + 166.4


def test_totals_in_kilojoules() -> None:
    with_maml, without = row("E, t0 = 210"), row("E, no MAML")
    assert with_maml.published == pytest.approx(105.826)
    # 210 x 4134.36 + 12 x 224 + 129.2 x 260.8 J
    assert with_maml.literal == pytest.approx(904.599, rel=1e-5)
    assert without.published == pytest.approx(226.96545)
    assert without.literal == pytest.approx(240.3272)  # 921.5 x 260.8 J
    assert "published agrees within rounding" in with_maml.verdict


def test_the_best_totals_are_less_than_their_fl_rounds_alone() -> None:
    assert row("E, t0 = 42").published == pytest.approx(106.30125)  # 42 x 352.4 + 371.5 x 246.3 J
    assert "91.5 kJ" in row("E, t0 = 42").note
    # 132 x (1182.36 + 1180.8) + 12 x 89.6 + 153.7 x (81.6 + 448) J
    assert row("E, t0 = 132").literal == pytest.approx(394.41, rel=1e-4)
    assert row("E, t0 = 132").published is None
    assert "81.4 kJ" in row("E, t0 = 132").note


def test_one_tasks_energy_allows_for_the_rounding_of_its_rounds() -> None:
    first, fifth = row("E_FL(t_1)"), row("E_FL(t_5)")
    assert first.published == pytest.approx(1.65021)  # 6.7 x 246.3 J; 6.65 rounds would print as 1.6
    assert "published agrees within rounding" in first.verdict
    assert fifth.published == pytest.approx(7.8816)
    assert fifth.literal == pytest.approx(8.3456)


def test_savings() -> None:
    every = row("the same, every t0, (200, 500)")
    # t0 = 240 is the dearest: 226,965 J / (240 x 352.4 + 104 x 246.3 J)
    assert every.published == pytest.approx(226_965.45 / 110_191.2)
    assert every.verdict == "literal does not hold; published holds"
    assert row("t0 of the least E, (200, 500)").literal == 0
    assert row("t0 of the least E, (200, 500)").published == 132
    assert row("t0 of the least E, (500, 200)").literal == 42


def test_bills_of_table_ii() -> None:
    assert implied_bill(0).ml.total_j == 0
    assert literal_bill(0, EFFICIENT_UPLINK).total_j == pytest.approx(921.5 * 529.6)
    assert literal_bill(42, EFFICIENT_SIDELINK).fl.total_j == pytest.approx(371.5 * 260.8)


@pytest.mark.parametrize(
    ("printed", "value", "agrees"),
    [("74", 74.5, True), ("74", 74.51, False), ("0.16", 0.155, True), ("0.16", 0.154, False), ("5.6", 5.565, True)],
)
def test_rounding_is_half_of_the_last_digit(printed: str, value: float, agrees: bool) -> None:
    assert AuditRow("", "", "", printed).agrees(value) is agrees


@pytest.mark.parametrize(
    ("arm", "t0", "efficiencies", "expected"),
    [
        ("maml", 210, (200e3, 500e3), HEADLINE),
        ("maml", 42, (200e3, 500e3), BEST_SIDELINK),
        ("maml", 30, (200e3, 500e3), HEADLINE),
        ("maml", 30, (500e3, 200e3), BEST_UPLINK),
        ("fl", 0, (200e3, 500e3), NO_MAML),
        ("fl", 0, (500e3, 200e3), None),
        ("maml", 210, (200e3, 400e3), None),
    ],
)
def test_the_printed_total_for_a_run(arm: str, t0: int, efficiencies: tuple[float, float], expected: object) -> None:
    assert printed_total(arm, t0, *efficiencies) == expected


def test_every_row_is_printed() -> None:
    console = Console(file=io.StringIO(), width=200)
    print_audit(console)
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue()
    for each in audit_rows():
        assert each.quantity in text
    assert "1022.1" in text  # Table II, t0 = 240 by the literal equations
