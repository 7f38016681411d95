"""Consensus FL, FL by a server and centralized learning at other efficiencies, worked out by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.common.errors import StudyError
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.countries import intensities
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.crossing import Footprint, Verdict, cheaper
from jouleswarm.report.table import csv_text
from jouleswarm.studies.engine import FACTS
from jouleswarm.studies.facts import Fact, read_facts
from jouleswarm.studies.record import read_record
from jouleswarm.studies.savazzi2021 import bills_csv, carbon_csv, thresholds_csv
from jouleswarm.studies.savazzi2021_cases import Case, cases, cheapest, grams, totals
from tests.studies.made_up import task_fact

RESULTS = Path(__file__).parents[2] / "results"
MB = 1_000_000
# A gradient is 2 J on a robot, and 1.5 * 10 = 15 J in the data center.
ENERGY = Energy(pk_w=5, tk_batch_s=0.4, p0_w=500, t0_batch_s=0.02, pue=1.5, ul_bit_per_j=100e3, sl_bit_per_j=300e3)


def one_round(seed: int = 1) -> list[Fact]:
    """Two robots, a model of 1 MB, 5 MB of frames from each."""
    consensus = {"sidelink_bytes": 2 * MB, "sidelink_sent_bytes": 2 * MB}
    server = {"links": 0, "sidelink_bytes": 0, "sidelink_sent_bytes": 0, "uplink_bytes": 2 * MB}
    center = server | {"uplink_bytes": 10 * MB, "gradients_robots": 0, "gradients_support": 40}
    return [
        task_fact(Arm("fl", "fl", 0), 1, 1, seed, **consensus),
        task_fact(Arm("fedavg", "fedavg", 0), 1, 1, seed, **server, downlink_bytes=2 * MB),
        task_fact(Arm("centralized", "centralized", 0), 1, 1, seed, **center, downlink_bytes=2 * MB),
    ]


def counted(energy: Energy = ENERGY) -> Case:
    return cases(one_round(), energy)["counted"]


def over(case: Case, other: str, ul: float) -> Verdict:
    held = totals(case)
    return cheaper(held["fl"].along_sl(ul), held[other].along_sl(ul))


def test_footprints_have_gamma_on_computing_and_on_the_way_down() -> None:
    held = totals(counted())
    assert held["fl"] == pytest.approx(Footprint(80, 0, 16e6))
    assert held["fedavg"] == pytest.approx(Footprint(80, 16e6 + 1.5 * 16e6, 0))
    assert held["centralized"] == pytest.approx(Footprint(600, 80e6 + 1.5 * 16e6, 0))


def test_with_the_same_rounds_one_neighbour_beats_a_server_above_e_ul_over_1_and_gamma() -> None:
    assert over(counted(), "fedavg", 200e3) == ("above", pytest.approx(200e3 / 2.5))
    efficient = ENERGY.model_copy(update={"base_station_pue": 1.0})
    assert over(counted(efficient), "fedavg", 200e3) == ("above", pytest.approx(200e3 / 2))


def test_consensus_beats_centralized_where_sidelinks_cost_less_than_is_saved() -> None:
    saved_j = 600 + 104e6 / 200e3 - 80  # 1040
    assert over(counted(), "centralized", 200e3) == ("above", pytest.approx(16e6 / saved_j))


def test_who_is_cheapest_at_a_point() -> None:
    held = totals(counted())
    assert [cheapest(held, 200e3, sl) for sl in (79e3, 81e3)] == ["fedavg", "fl"]


def test_table_i_s_weights_leave_frames_and_gradients_as_they_were() -> None:
    found = cases(one_round(), ENERGY)
    assert totals(found["paper"])["fl"] == pytest.approx(Footprint(80, 0, 5.6 * 16e6))
    assert totals(found["paper"])["fedavg"] == pytest.approx(Footprint(80, 5.6 * 40e6, 0))
    assert totals(found["paper"])["centralized"] == pytest.approx(Footprint(600, 80e6 + 5.6 * 24e6, 0))
    resized = 80e6 * 96 * 72 / (640 * 480)
    assert totals(found["resized"])["centralized"] == pytest.approx(Footprint(600, resized + 5.6 * 24e6, 0))


def test_a_base_station_between_robots_takes_both_ways() -> None:
    energy = ENERGY.model_copy(update={"sidelink": "via_base_station"})
    assert totals(counted(energy))["fl"] == pytest.approx(Footprint(80, 16e6 + 1.5 * 16e6, 0))


def test_grams_weigh_each_site_by_its_country() -> None:
    robots, center = (intensities()[country] / 3.6e6 for country in ("NO", "PL"))
    held = totals(counted(), *grams("NO", "PL"))["centralized"]
    assert held == pytest.approx(Footprint(600 * center, 80e6 * robots + 24e6 * center, 0))


def test_seeds_are_told_beside_their_mean() -> None:
    slow = [fact.model_copy(update={"gradients_robots": 60}) if fact.arm == "fedavg" else fact for fact in one_round(2)]
    table = thresholds_csv(cases([*one_round(), *slow], ENERGY))
    row = next(row for row in table.rows if row[:5] == ["counted", "fl", "fedavg", "sidelink", 200.0])
    # 16e6 bits over 200 J, over 240 J in seed 2, and over 220 J of the mean
    assert row[5:] == ["above", pytest.approx(16e3 / 220), pytest.approx(16e3 / 240), pytest.approx(80.0)]


def test_a_method_without_facts_is_told() -> None:
    with pytest.raises(StudyError, match="fl 1, fedavg 1, centralized 0; expected the same of each"):
        cases(one_round()[:2], ENERGY)


def test_committed_tables_are_what_the_committed_facts_come_to() -> None:
    baselines = RESULTS / "compact-baselines"
    energy = read_record(baselines).scenario.energy
    found = cases(read_facts(baselines / FACTS), energy)
    made = {"bills": bills_csv(found), "thresholds": thresholds_csv(found), "carbon": carbon_csv(found, energy)}
    for name, table in made.items():
        assert csv_text(table) == (RESULTS / "savazzi2021" / f"{name}.csv").read_text()
