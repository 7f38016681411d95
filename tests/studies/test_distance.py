"""The study of distance: direct sidelinks against those via a base station that moves away."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.runs.sizes import scenario_sizes
from jouleswarm.studies.distance import Point, crossing_m, points, study_distance, verdict

# All ends within 2 km of each other have an SNR of 20 dBm - 100 dB + 100 dBm = 20 dB, after the gap 1 bit/s/Hz:
# 1 Mbit/s at 0.5 W of a sender and 0.2 W of a receiver.
FLAT: list[tuple[str, object]] = [
    ("energy.pue", 2.0),
    (
        "energy.distance",
        {
            "row_spacing_m": 50, "transmit_w": 0.1, "amplifier_efficiency": 0.5, "transmit_circuit_w": 0.3,
            "receive_w": 0.2, "bandwidth_hz": 1e6, "reference_m": 2000, "reference_loss_db": 100,
            "noise_figure_db": 14, "gap_db": 20,
        },
    ),
]  # fmt: skip


def test_a_round_costs_what_it_does_by_hand_and_is_written_down(tmp_path: Path) -> None:
    scenario = load_scenario("toy", FLAT)
    bits = 2 * 8 * scenario_sizes(scenario).weights_bytes  # two robots, a message each
    first, last = (found := points(scenario))[0], found[-1]
    assert (first.base_station_m, last.base_station_m) == (1, pytest.approx(1000))
    assert first.up_bit_per_s == pytest.approx(1e6)
    assert first.direct_j == last.direct_j == pytest.approx(bits * 0.7e-6)
    assert first.up_j == pytest.approx(bits * (0.5 + 2 * 0.2) * 1e-6)
    assert last.via_j == pytest.approx(bits * (0.9 + 2 * 0.5 + 0.2) * 1e-6)  # three times as much
    said, written = study_distance(scenario, tmp_path)
    assert said == "via the base station costs more from 1 to 1000 m"
    assert [path.name for path in written] == ["distance.csv", "distance.png", "distance.svg"]
    rows = list(csv.DictReader(written[0].read_text().splitlines()))
    assert (len(rows), float(rows[0]["direct_j"])) == (61, pytest.approx(first.direct_j, rel=1e-5))


def test_where_going_via_the_base_station_stops_to_pay() -> None:
    found = [Point(far, 5.0, 0.1 * far, 0.0, 1.0) for far in (1.0, 10.0, 100.0)]
    assert crossing_m(found) == pytest.approx(50)
    assert verdict(found) == "via the base station costs less where it is nearer than 50 m"
    assert verdict(found[:2]) == "via the base station costs less from 1 to 10 m"


def test_robots_stand_somewhere() -> None:
    with pytest.raises(ConfigurationError, match="robot 1 has no position, expected position_m in its"):
        points(load_scenario("toy"))
