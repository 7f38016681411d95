"""The energy columns that a report holds side by side, from what the paper prints to whole packets."""

from __future__ import annotations

from typing import NamedTuple

from common.energy import TABLE_I, Bill, PublishedBill, RoundSizes, bill, downlink_bit_per_j, published_bill, transfer_j
from common.settings import Energy
from common.topics import Link
from fleet.expected import expected_counts, scenario_sizes
from fleet.paper import printed_total
from fleet.pricing import counts
from fleet.report_data import Run
from fleet.traffic import DATA_CENTER, RECORDER, Measure, deliveries

PARTS = ("ml_learning", "ml_communication", "ml", "fl_learning", "fl_communication", "fl", "total")

Parts = dict[str, float | None]  # joules by PARTS; None = not defined or not known


class Column(NamedTuple):
    """One column of the energy table."""

    label: str
    joules: Parts


def columns(run: Run, arm: str, energy: Energy) -> list[Column]:
    """The energy columns of DESIGN section 6 for one arm, from what is printed to whole packets."""
    t0 = run.t0 if arm == "maml" else 0
    printed = printed_total(arm, t0, energy.ul_bit_per_j, energy.sl_bit_per_j)
    headed = f"paper (t0 = {printed.t0})" if printed and arm == "maml" else "paper"
    implied = published_bill(t0, sum(run.rounds(arm).values()), energy)
    return [
        Column(headed, _stages(printed and printed.ml_j, None, printed and printed.total_j)),
        Column("published prices", _of_published(implied)),
        Column("Table I sizes", closed_parts(run, arm, energy, TABLE_I)),
        Column("scenario sizes", closed_parts(run, arm, energy)),
        Column("measured payload", measured_parts(run, arm, energy, "payload")),
        Column("measured packets", measured_parts(run, arm, energy, "packet")),
    ]


def closed_parts(run: Run, arm: str, energy: Energy, sizes: RoundSizes | None = None) -> Parts:
    """An arm's bill from its round numbers alone."""
    t0 = run.t0 if arm == "maml" else 0
    found = expected_counts(run.scenario, t0, run.rounds(arm), sizes or scenario_sizes(run.scenario))
    return _of_bill(bill(found, energy), metered=True)


def measured_parts(run: Run, arm: str, energy: Energy, measure: Measure = "payload") -> Parts:
    """An arm's bill from the gradients it computed and the bytes that were metered."""
    found = counts(run.rows, run.meter_rows, arm, measure=measure)
    return _of_bill(bill(found, energy), metered=bool(run.meter_rows))


def control_j(run: Run, arm: str, energy: Energy) -> float:
    """What an arm's control and telemetry would cost: to robots at E_DL, to the others at E_UL. Never in a bill."""
    total_j = 0.0
    for row in deliveries(run.meter_rows, arm, Link.CONTROL):
        upward = row.client in (DATA_CENTER, RECORDER)
        total_j += transfer_j(row.payload_bytes, energy.ul_bit_per_j if upward else downlink_bit_per_j(energy))
    return total_j


def _of_bill(priced: Bill, metered: bool) -> Parts:
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
