"""Every published number with its place, beside what it should be: the rows of the audit.

Printed values are quoted; everything beside them is computed by the two price lists from Tables I and II.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import Bill
from jouleswarm.energy.closed_form import ClusterRounds, closed_form
from jouleswarm.energy.facts import Counts
from jouleswarm.energy.literal import bill, data_center_gradient_j, price, robot_gradient_j
from jouleswarm.energy.published import (
    PUBLISHED_FL_ROUND_J,
    PUBLISHED_ML_ROUND_J,
    TRAINING_ROBOTS,
    published_bill,
)
from jouleswarm.runs.paper import HEADLINE, TABLE_II, TRAINING_TASKS

EFFICIENT_SIDELINK = Energy()  # Table I, (E_UL, E_SL) = (200, 500) kb/J
EFFICIENT_UPLINK = Energy(ul_bit_per_j=500e3, sl_bit_per_j=200e3)

_TABLE_II_HALF_UNIT = 0.05
_STAGED = [t0 for t0 in TABLE_II if t0 > 0]
Relation = Literal["equals", "at least"]


@dataclass(frozen=True)
class AuditRow:
    """One printed number and what each source gives for it, None where a source says nothing."""

    place: str
    quantity: str
    unit: str
    printed: str
    table_ii: float | None = None
    literal: float | None = None
    published: float | None = None
    relation: Relation = "equals"
    slack: float = 0.0  # what the rounding of Table II's own entries allows, in the row's unit
    note: str = ""

    @property
    def printed_value(self) -> float:
        """The printed number."""
        return float(self.printed)

    @property
    def half_unit(self) -> float:
        """Half of the last printed digit: what rounding explains."""
        decimals = len(self.printed.partition(".")[2])
        return 0.5 * float(10**-decimals)

    def agrees(self, value: float) -> bool:
        """Whether `value` is what is printed, within rounding."""
        if self.relation == "at least":
            return value >= self.printed_value
        allowed = (self.half_unit + self.slack) * (1 + 1e-9)
        return abs(value - self.printed_value) <= allowed

    @property
    def given(self) -> dict[str, float]:
        """The sources that say something, by name."""
        sources = {"Table II": self.table_ii, "literal": self.literal, "published": self.published}
        return {name: value for name, value in sources.items() if value is not None}

    @property
    def consistent(self) -> bool:
        """Whether every source agrees with what is printed."""
        return all(self.agrees(value) for value in self.given.values())

    @property
    def verdict(self) -> str:
        """One verdict a source, in words."""
        return "; ".join(f"{name} {self._judge(value)}" for name, value in self.given.items())

    def _judge(self, value: float) -> str:
        if self.relation == "at least":
            return "holds" if self.agrees(value) else "does not hold"
        if self.agrees(value):
            return "agrees within rounding"
        percent = 100 * (value / self.printed_value - 1)
        return f"differs by {percent:+.1f}%" if abs(percent) < 100 else f"differs by {percent:+,.0f}%"


def literal_bill(t0: int, energy: Energy) -> Bill:
    """The paper's experiment by eqs. (8)-(12) with Table I's sizes and the rounds of Table II's row `t0`."""
    clusters = [ClusterRounds(rounds) for rounds in TABLE_II[t0]]
    return bill(closed_form(t0, TRAINING_ROBOTS, clusters), energy)


def implied_bill(t0: int) -> Bill:
    """The same by the published price list, at (200, 500) kb/J."""
    return _published(t0, sum(TABLE_II[t0]))


def audit_rows() -> list[AuditRow]:
    """Every published number that can be held against another."""
    return [*_table_i(), *_rounds(), *_per_round(), *_totals(), *_savings()]


def _table_i() -> list[AuditRow]:
    center = 1 / data_center_gradient_j(EFFICIENT_SIDELINK)
    robot = 1 / robot_gradient_j(EFFICIENT_SIDELINK)
    return [
        AuditRow("Table I", "E_C of the data center = 1 / (P_0 T_0)", "grad/J", "0.03", literal=center),
        AuditRow("Table I", "E_C of a robot = 1 / (P_k T_k)", "grad/J", "0.16", literal=robot),
        AuditRow(
            "Table I", "b(E) = 20 motions x 640 x 480 x 4 B", "MB", "24.6", literal=20 * 640 * 480 * 4 / 1e6,
            note="the frame format is ours; the paper prints the size only",
        ),
        AuditRow("Table I", "b(W) = 1.3 M float32 (section IV-A)", "MB", "5.6", literal=1.3e6 * 4 / 1e6),
    ]  # fmt: skip


def _rounds() -> list[AuditRow]:
    without, headline, last = TABLE_II[0], TABLE_II[HEADLINE.t0], TABLE_II[240]
    trained = sum(last[task - 1] for task in TRAINING_TASKS)
    return [
        AuditRow("IV-C", "sum of t_i, no MAML", "rounds", "910", sum(without)),
        AuditRow("IV-C", "sum of t_i, t0 = 240", "rounds", "103", sum(last)),
        AuditRow("IV-C", "the first over the second, \"up to\"", "x", "9", sum(without) / sum(last)),
        AuditRow("IV-C", "t_3 + t_4 + t_5, new tasks, t0 = 240", "rounds", "70.9", sum(last) - trained),
        AuditRow("IV-C", "t_1 + t_2 + t_6, training tasks, t0 = 240", "rounds", "33.1", trained),
        AuditRow("IV-B, Fig. 3b", "t_1 at t0 = 210", "rounds", "7", headline[0]),
        AuditRow("IV-B, Fig. 3b", "t_5 at t0 = 210", "rounds", "32", headline[4]),
        AuditRow("IV-B, Fig. 3b", "t_1, no MAML", "rounds", "380", without[0]),
        AuditRow("IV-B, Fig. 3b", "t_5, no MAML", "rounds", "24", without[4]),
        AuditRow(
            "IV-B", "robots' energy cut, \"up to ... for all tasks\"", "x", "10",
            max(a / b for a, b in zip(without, headline, strict=True)),
            note=f"task 5 is {headline[4] / without[4]:.1f}x dearer with the meta-model",
        ),
    ]  # fmt: skip


def _per_round() -> list[AuditRow]:
    ml = bill(closed_form(1, TRAINING_ROBOTS, []), EFFICIENT_SIDELINK)
    fl = bill(closed_form(0, 0, [ClusterRounds(1)]), EFFICIENT_SIDELINK)
    light_j = fl.fl.learning_j + price(Counts(sidelink_bytes=2 * 5.2e6), EFFICIENT_SIDELINK).sidelink_j
    return [
        AuditRow(
            "IV-B", "one MAML round: 74 kJ / 210", "J", "352", literal=ml.ml.total_j, published=PUBLISHED_ML_ROUND_J,
            note=f"literal is {ml.ml.learning_j:.1f} J learning + {ml.ml.communication_j:.1f} J uplink",
        ),
        AuditRow(
            "IV-B", "one FL round: 227 kJ / 921.5", "J", "246", literal=fl.fl.total_j, published=PUBLISHED_FL_ROUND_J,
            note=f"literal is {fl.fl.learning_j:.1f} J learning + {fl.fl.communication_j:.1f} J sidelinks; "
            f"{light_j:.1f} J with weights of 1.3 M x 4 B = 5.2 MB",
        ),
        AuditRow(
            "Fig. 3, caption", "a MAML round over an FL round", "x", "1", literal=ml.ml.total_j / fl.fl.total_j,
            published=PUBLISHED_ML_ROUND_J / PUBLISHED_FL_ROUND_J, relation="at least",
        ),
    ]  # fmt: skip


def _totals() -> list[AuditRow]:
    at_210, at_42, without = (literal_bill(t0, EFFICIENT_SIDELINK) for t0 in (210, 42, 0))
    first, fifth = TABLE_II[210][0], TABLE_II[210][4]
    at_132 = literal_bill(132, EFFICIENT_UPLINK)
    return [
        _kilojoules("IV-B, Fig. 3a", "E_ML, t0 = 210", "74", at_210.ml.total_j, implied_bill(210).ml.total_j),
        _one_task("E_FL(t_1), t0 = 210", "1.6", first),
        _one_task("E_FL(t_5), t0 = 210", "7.9", fifth),
        _kilojoules("IV-B", "E, t0 = 210", "106", at_210.total_j, implied_bill(210).total_j),
        _kilojoules("IV-B", "E, no MAML", "227", without.total_j, implied_bill(0).total_j),
        replace(
            _kilojoules("IV-C", "E, t0 = 42, (200, 500) kb/J", "56", at_42.total_j, implied_bill(42).total_j),
            note=f"its {sum(TABLE_II[42]):.1f} FL rounds alone are {implied_bill(42).fl.total_j / 1e3:.1f} kJ as "
            "published",
        ),
        replace(
            _kilojoules("IV-C", "E, t0 = 132, (500, 200) kb/J", "52", at_132.total_j, None),
            note=f"its {sum(TABLE_II[132]):.1f} FL rounds alone are {at_132.fl.total_j / 1e3:.1f} kJ",
        ),
    ]


def _savings() -> list[AuditRow]:
    def least(energy: Energy) -> int:
        return min(TABLE_II, key=lambda t0: literal_bill(t0, energy).total_j)

    def saving(energy: Energy) -> float:
        without_j = literal_bill(0, energy).total_j
        return min(without_j / literal_bill(t0, energy).total_j for t0 in _STAGED)

    implied_j = {t0: implied_bill(t0).total_j for t0 in TABLE_II}
    headline = literal_bill(0, EFFICIENT_SIDELINK).total_j / literal_bill(210, EFFICIENT_SIDELINK).total_j
    return [
        AuditRow(
            "IV-B", "E without over with MAML, t0 = 210", "x", "2", literal=headline,
            published=implied_j[0] / implied_j[210], note="printed as \"approx. two times\"",
        ),
        AuditRow(
            "abstract, IV-C", "the same, every t0, (200, 500) kb/J", "x", "2", literal=saving(EFFICIENT_SIDELINK),
            published=min(implied_j[0] / implied_j[t0] for t0 in _STAGED), relation="at least",
        ),
        AuditRow(
            "abstract, IV-C", "the same, every t0, (500, 200) kb/J", "x", "2", literal=saving(EFFICIENT_UPLINK),
            relation="at least",
        ),
        AuditRow(
            "IV-C", "t0 of the least E, (200, 500) kb/J", "rounds", "42", literal=least(EFFICIENT_SIDELINK),
            published=min(implied_j, key=lambda t0: implied_j[t0]), note="0 means that MAML does not pay",
        ),
        AuditRow("IV-C", "t0 of the least E, (500, 200) kb/J", "rounds", "132", literal=least(EFFICIENT_UPLINK)),
    ]  # fmt: skip


def _kilojoules(place: str, quantity: str, printed: str, literal_j: float, published_j: float | None) -> AuditRow:
    published = None if published_j is None else published_j / 1e3
    return AuditRow(place, quantity, "kJ", printed, literal=literal_j / 1e3, published=published)


def _one_task(quantity: str, printed: str, rounds: float) -> AuditRow:
    literal_j = bill(closed_form(0, 0, [ClusterRounds(rounds)]), EFFICIENT_SIDELINK).fl.total_j
    row = _kilojoules("IV-B, Fig. 3a", quantity, printed, literal_j, _published(0, rounds).fl.total_j)
    return replace(row, slack=_TABLE_II_HALF_UNIT * PUBLISHED_FL_ROUND_J / 1e3)


def _published(t0: float, fl_rounds: float) -> Bill:
    priced = published_bill(t0, fl_rounds, EFFICIENT_SIDELINK)
    assert priced is not None  # defined at these efficiencies
    return priced
