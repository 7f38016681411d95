"""Models of links over the made-up run: a column, a panel and a key each, as a list of the user's own has them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jouleswarm import Run
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.report.bars import energy_figure
from jouleswarm.report.notes import notes
from jouleswarm.report.tables import bytes_table, totals_table
from jouleswarm.runs.run import load_run
from jouleswarm.runs.summary import summarise

LABELS = ["by distance", "by frame", "by radio states (LTE)"]
ENERGY = {
    "prices": ["literal", "distance", "frames", "radio_states"],
    "distance": {"base_station_m": [0, 30], "row_spacing_m": 10},
}


def test_each_has_its_place_everywhere(write_run: Callable[..., Path], facts: Any) -> None:
    scenario = scenario_from({**facts.scenario.model_dump(mode="json"), "energy": ENERGY}, "made-up")
    summary = summarise(scenario, facts.rows, facts.meter_rows)
    path = write_run(summary, energy=ENERGY)
    run = load_run(path)
    energy = run.scenario.energy
    assert totals_table(run, energy).headings[-3:] == LABELS
    assert len(energy_figure(run, energy).axes) == 3 * 4
    assert "by frame (frames)" in " ".join(notes(run, energy))
    (control,) = [row for row in bytes_table(run, energy).rows if row[0] == "MAML, t0 = 3: control"]
    assert control[-4:] == ["0.028 J", "-", "-", "-"]  # who sent it is not known, nor how far it went
    up = summary["arms"]["maml"]["energy_j"]["frames"]["by_cause"]["uplink"]
    sent, got = (0.126e-3 + watts * (8 * 1188 / 48e6 + 20e-6) for watts in (0.8066, 0.0634))
    assert up == pytest.approx(120 * (sent + got))  # 120 packets of 1100 B, a frame each, with 88 B of headers
    side = summary["arms"]["fl"]["energy_j"]["radio_states"]["by_cause"]["sidelink"]
    bit_j = 438.39e-9 + 1.28804 / 5.64e6 + 51.97e-9 + 1.28804 / 12.74e6
    assert side == pytest.approx(60 * (1.2107 * 0.2601 + 1.06 * 11.6 + 8 * 5040 * bit_j))  # 60 robot-rounds
    bill = Run(path).bill("frames")["ml"].loc["maml"]
    assert (bill["uplink"], bill["uplink_datacenter"]) == pytest.approx((120 * sent, 120 * got))
