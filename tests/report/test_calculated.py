"""Seconds and grams of what ran elsewhere, worked out by hand."""

from __future__ import annotations

from typing import Any

import pytest

from jouleswarm.report.calculated import calculate, document

COUNTS: dict[str, Any] = {
    "robots": 10, "model_bytes": 2_400_000, "batches": 50, "rounds": 40, "t0": 30,
    "training_robots": 4, "experience_bytes": 3_000_000, "support_batches": 10, "query_batches": 10,
}  # fmt: skip


def test_seconds_where_rates_are_given() -> None:
    rates = ["energy.ul_bit_per_s=20e6"]
    (arm,) = document(calculate(COUNTS, changes=rates))["arms"].values()
    # a stage round: four times 24 Mbit at 20 Mbit/s one after the other, then 80 gradients of 20 ms; ten models down
    assert arm["seconds"]["ml"]["total_s"] == pytest.approx(30 * (4 * 1.2 + 1.6) + 10 * 0.96)
    # a round: 50 gradients of 0.4 s, ten models up and ten down
    assert arm["seconds"]["total"]["total_s"] == pytest.approx(201.6 + 40 * (20 + 20 * 0.96))
    assert "seconds" not in next(iter(document(calculate(COUNTS))["arms"].values()))


def test_grams_by_country() -> None:
    (arm,) = document(calculate(COUNTS, changes=["energy.robots_country=FI", "energy.datacenter_g_per_kwh=36"]))[
        "arms"
    ].values()
    told = arm["energy_j"]["literal"]
    assert told["carbon_g"]["datacenter_g"] == pytest.approx(told["by_site"]["datacenter"] / 1e5)
    assert told["carbon_g"]["robots_g"] == pytest.approx(told["by_site"]["robots"] / 3.6e6 * 79.158)
