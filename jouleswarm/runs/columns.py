"""The energy columns that a report holds side by side, from what the paper prints to whole packets."""

from __future__ import annotations

from typing import NamedTuple

from jouleswarm.common.scenario.arms import method_of
from jouleswarm.common.scenario.sections import Energy
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.bill import Bill, PublishedBill
from jouleswarm.energy.equations import TABLE_I, RoundSizes, bill, downlink_bit_per_j, transfer_j
from jouleswarm.runs.beta import with_beta
from jouleswarm.runs.facts import arm_counts
from jouleswarm.runs.paper import is_papers_scenario, printed_total, published_here
from jouleswarm.runs.run import Run
from jouleswarm.runs.sizes import expected_counts, scenario_sizes
from jouleswarm.runs.traffic import DATA_CENTER, RECORDER, Measure, deliveries

PARTS = ("ml_learning", "ml_communication", "ml", "fl_learning", "fl_communication", "fl", "total")

NOT_DEFINED = "not defined here"
"""`about` of a column whose price list implies nothing for this arm."""

Parts = dict[str, float | None]  # joules by PARTS; None = not defined or not known


class Column(NamedTuple):
    """One column of the energy table; `about` tells what it holds for this arm where that is not the run's own."""

    label: str
    joules: Parts
    about: str = ""


def columns(run: Run, arm: str, energy: Energy) -> list[Column]:
    """The energy columns of one arm, from what is printed to whole packets."""
    method, t0 = method_of(arm), run.t0[arm]
    is_papers = is_papers_scenario(run.scenario, energy)
    printed = printed_total(method, t0, energy.ul_bit_per_j, energy.sl_bit_per_j) if is_papers else None
    about = f"t0 = {printed.t0}" if printed and printed.t0 else ""
    implied = published_here(method, t0, sum(run.rounds(arm).values()), run.scenario, energy)
    return [
        Column("paper", _stages(printed and printed.ml_j, None, printed and printed.total_j), about),
        Column("published prices", _of_published(implied), "" if implied else NOT_DEFINED),
        Column("Table I sizes", _of_bill(closed_bill(run, arm, energy, TABLE_I))),
        Column("scenario sizes", _of_bill(closed_bill(run, arm, energy))),
        Column("measured payload", measured_parts(run, arm, energy, "payload")),
        Column("measured packets", measured_parts(run, arm, energy, "packet")),
    ]


def closed_bill(run: Run, arm: str, energy: Energy, sizes: RoundSizes | None = None) -> Bill:
    """An arm's bill from its round numbers alone."""
    method = method_of(arm)
    alone = run.scenario.method(method).partners == "nobody"
    rounds = run.mean_rounds(arm) if alone else run.rounds(arm)
    found = expected_counts(run.scenario, method, run.t0[arm], rounds, sizes or scenario_sizes(run.scenario))
    return bill(found, with_beta(energy, run.rows, arm))


def measured_bill(run: Run, arm: str, energy: Energy, measure: Measure = "payload") -> Bill:
    """An arm's bill from the gradients it computed and the bytes that were metered, if any were."""
    counts = arm_counts(run.rows, run.meter_rows, arm, measure=measure, lost=run.lost)
    return bill(counts, with_beta(energy, run.rows, arm))


def measured_parts(run: Run, arm: str, energy: Energy, measure: Measure = "payload") -> Parts:
    """`measured_bill` by stage and cause; what needs bytes is None where none were metered."""
    return _of_bill(measured_bill(run, arm, energy, measure), metered=bool(run.meter_rows))


def control_j(run: Run, arm: str, energy: Energy) -> float:
    """What an arm's control and telemetry would cost: to robots at E_DL, to the others at E_UL. Never in a bill."""
    total_j = 0.0
    for row in deliveries(run.meter_rows, arm, Link.CONTROL):
        upward = row.client in (DATA_CENTER, RECORDER)
        total_j += transfer_j(row.payload_bytes, energy.ul_bit_per_j if upward else downlink_bit_per_j(energy))
    return total_j


def _of_bill(priced: Bill, metered: bool = True) -> Parts:
    def known(joules: float) -> float | None:
        return joules if metered else None

    return {
        "ml_learning": priced.ml_learning_j,
        "ml_communication": known(priced.ml_communication_j),
        "ml": known(priced.ml_j),
        "fl_learning": priced.fl_learning_j,
        "fl_communication": known(priced.fl_communication_j),
        "fl": known(priced.fl_j),
        "total": known(priced.total_j),
    }


def _of_published(priced: PublishedBill | None) -> Parts:
    return _stages(*(priced.ml_j, priced.fl_j, priced.total_j) if priced else (None, None, None))


def _stages(ml: float | None, fl: float | None, total: float | None) -> Parts:
    return dict.fromkeys(PARTS) | {"ml": ml, "fl": fl, "total": total}
