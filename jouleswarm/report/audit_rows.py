"""Every published number with its place, beside what it should be: the rows of the audit.

Printed values are quoted; everything beside them is computed by the two price lists from Tables I and II.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

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
from jouleswarm.runs.paper import TABLE_II, TRAINING_TASKS

EFFICIENT_SIDELINK = Energy()  # Table I, (E_UL, E_SL) = (200, 500) kb/J
EFFICIENT_UPLINK = Energy(ul_bit_per_j=500e3, sl_bit_per_j=200e3)

_TABLE_II_HALF_UNIT = 0.05
_STAGED = [t0 for t0 in TABLE_II if t0 > 0]


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
    note: str = ""
    at_least: bool = False  # what is printed is a bound
    slack: float = 0.0  # what the rounding of Table II's own entries allows, in the row's unit

    def agrees(self, value: float) -> bool:
        """Whether `value` is what is printed, within rounding: half of the last printed digit."""
        if self.at_least:
            return value >= float(self.printed)
        half_unit = 0.5 * 10.0 ** -len(self.printed.partition(".")[2])
        return abs(value - float(self.printed)) <= (half_unit + self.slack) * (1 + 1e-9)

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
        if self.agrees(value):
            return "holds" if self.at_least else "agrees within rounding"
        percent = 100 * (value / float(self.printed) - 1)
        if self.at_least:
            return "does not hold"
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
    energy, place, sized = EFFICIENT_SIDELINK, "Table I", "the frame format is ours; the paper prints the size only"
    return [
        AuditRow(
            place,
            "E_C of the data center = 1 / (P_0 T_0)",
            "grad/J",
            "0.03",
            literal=1 / data_center_gradient_j(energy),
        ),
        AuditRow(place, "E_C of a robot = 1 / (P_k T_k)", "grad/J", "0.16", literal=1 / robot_gradient_j(energy)),
        AuditRow(
            place, "b(E) = 20 motions x 640 x 480 x 4 B", "MB", "24.6", literal=20 * 640 * 480 * 4 / 1e6, note=sized
        ),
        AuditRow(place, "b(W) = 1.3 M float32 (section IV-A)", "MB", "5.6", literal=1.3e6 * 4 / 1e6),
    ]


def _rounds() -> list[AuditRow]:
    without, headline, last = TABLE_II[0], TABLE_II[210], TABLE_II[240]
    trained = sum(last[task - 1] for task in TRAINING_TASKS)
    most = max(a / b for a, b in zip(without, headline, strict=True))
    dearer = f"task 5 is {headline[4] / without[4]:.1f}x dearer with the meta-model"
    return [
        AuditRow("IV-C", "sum of t_i, no MAML", "rounds", "910", sum(without)),
        AuditRow("IV-C", "sum of t_i, t0 = 240", "rounds", "103", sum(last)),
        AuditRow("IV-C", 'the first over the second, "up to"', "x", "9", sum(without) / sum(last)),
        AuditRow("IV-C", "t_3 + t_4 + t_5, new tasks, t0 = 240", "rounds", "70.9", sum(last) - trained),
        AuditRow("IV-C", "t_1 + t_2 + t_6, training tasks, t0 = 240", "rounds", "33.1", trained),
        AuditRow("IV-B, Fig. 3b", "t_1 at t0 = 210", "rounds", "7", headline[0]),
        AuditRow("IV-B, Fig. 3b", "t_5 at t0 = 210", "rounds", "32", headline[4]),
        AuditRow("IV-B, Fig. 3b", "t_1, no MAML", "rounds", "380", without[0]),
        AuditRow("IV-B, Fig. 3b", "t_5, no MAML", "rounds", "24", without[4]),
        AuditRow("IV-B", 'robots\' energy cut, "up to ... for all tasks"', "x", "10", most, note=dearer),
    ]


def _per_round() -> list[AuditRow]:
    ml = bill(closed_form(1, TRAINING_ROBOTS, []), EFFICIENT_SIDELINK).ml
    fl = bill(closed_form(0, 0, [ClusterRounds(1)]), EFFICIENT_SIDELINK).fl
    light_j = fl.learning_j + price(Counts(sidelink_bytes=2 * 5.2e6), EFFICIENT_SIDELINK).sidelink_j
    ml_parts = f"literal is {ml.learning_j:.1f} J learning + {ml.communication_j:.1f} J uplink"
    fl_parts = (
        f"literal is {fl.learning_j:.1f} J learning + {fl.communication_j:.1f} J sidelinks; "
        f"{light_j:.1f} J with weights of 1.3 M x 4 B = 5.2 MB"
    )
    ml_j, fl_j = (ml.total_j, PUBLISHED_ML_ROUND_J), (fl.total_j, PUBLISHED_FL_ROUND_J)
    ratios = [one / other for one, other in zip(ml_j, fl_j, strict=True)]
    return [
        _priced("IV-B", "one MAML round: 74 kJ / 210", "J", "352", ml_j, ml_parts),
        _priced("IV-B", "one FL round: 227 kJ / 921.5", "J", "246", fl_j, fl_parts),
        _priced("Fig. 3, caption", "a MAML round over an FL round", "x", "1", ratios, at_least=True),
    ]


def _totals() -> list[AuditRow]:
    at_210, at_42, without = ((literal_bill(t0, EFFICIENT_SIDELINK), implied_bill(t0)) for t0 in (210, 42, 0))
    at_132 = literal_bill(132, EFFICIENT_UPLINK)
    alone = [
        f"its {sum(TABLE_II[t0]):.1f} FL rounds alone are {found.fl.total_j / 1e3:.1f} kJ"
        for t0, found in ((42, at_42[1]), (132, at_132))
    ]

    def row(place: str, quantity: str, printed: str, joules: Iterable[float], note: str = "") -> AuditRow:
        return _priced(place, quantity, "kJ", printed, [each / 1e3 for each in joules], note)

    return [
        row("IV-B, Fig. 3a", "E_ML, t0 = 210", "74", (each.ml.total_j for each in at_210)),
        _one_task("E_FL(t_1), t0 = 210", "1.6", TABLE_II[210][0]),
        _one_task("E_FL(t_5), t0 = 210", "7.9", TABLE_II[210][4]),
        row("IV-B", "E, t0 = 210", "106", (each.total_j for each in at_210)),
        row("IV-B", "E, no MAML", "227", (each.total_j for each in without)),
        row("IV-C", "E, t0 = 42, (200, 500) kb/J", "56", (each.total_j for each in at_42), f"{alone[0]} as published"),
        row("IV-C", "E, t0 = 132, (500, 200) kb/J", "52", [at_132.total_j], alone[1]),
    ]


def _one_task(quantity: str, printed: str, rounds: float) -> AuditRow:
    literal_j = bill(closed_form(0, 0, [ClusterRounds(rounds)]), EFFICIENT_SIDELINK).fl.total_j
    row = _priced("IV-B, Fig. 3a", quantity, "kJ", printed, (literal_j / 1e3, _published(0, rounds).fl.total_j / 1e3))
    return replace(row, slack=_TABLE_II_HALF_UNIT * PUBLISHED_FL_ROUND_J / 1e3)


def _savings() -> list[AuditRow]:
    sidelink, uplink = (
        {t0: literal_bill(t0, energy).total_j for t0 in TABLE_II} for energy in (EFFICIENT_SIDELINK, EFFICIENT_UPLINK)
    )
    implied = {t0: implied_bill(t0).total_j for t0 in TABLE_II}
    priced = (sidelink, implied)
    headline = [joules[0] / joules[210] for joules in priced]
    least = [min(joules[0] / joules[t0] for t0 in _STAGED) for joules in (*priced, uplink)]
    best = [min(joules, key=joules.__getitem__) for joules in (*priced, uplink)]
    places, every, of = "abstract, IV-C", "the same, every t0,", "t0 of the least E,"
    about, zero = 'printed as "approx. two times"', "0 means that MAML does not pay"
    return [
        _priced("IV-B", "E without over with MAML, t0 = 210", "x", "2", headline, about),
        _priced(places, f"{every} (200, 500) kb/J", "x", "2", least[:2], at_least=True),
        _priced(places, f"{every} (500, 200) kb/J", "x", "2", least[2:], at_least=True),
        _priced("IV-C", f"{of} (200, 500) kb/J", "rounds", "42", best[:2], zero),
        _priced("IV-C", f"{of} (500, 200) kb/J", "rounds", "132", best[2:]),
    ]


def _priced(
    place: str,
    quantity: str,
    unit: str,
    printed: str,
    found: Sequence[float],
    note: str = "",
    *,
    at_least: bool = False,
) -> AuditRow:
    """A row of what the literal list gives, and the published one where it is defined."""
    published = found[1] if len(found) > 1 else None
    return AuditRow(place, quantity, unit, printed, literal=found[0], published=published, note=note, at_least=at_least)


def _published(t0: float, fl_rounds: float) -> Bill:
    priced = published_bill(t0, fl_rounds, EFFICIENT_SIDELINK)
    assert priced is not None  # defined at these efficiencies
    return priced
