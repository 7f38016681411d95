"""A price list of the user's own over the made-up run of conftest.py: examples/cellular.py, 0.9 J a message up.

120 messages of 1000 B go up in MAML's phase ml: 108 J more than the equations have; FL sends none.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.facts import STAGE, Flow, Work
from jouleswarm.report.answer import answer, said
from jouleswarm.report.bars import energy_figure
from jouleswarm.report.notes import notes
from jouleswarm.report.report import report
from jouleswarm.report.tables import bytes_table, causes_tables, energy_table, sites_tables, totals_table
from jouleswarm.runs.directory import SUMMARY
from jouleswarm.runs.run import Run, load_run
from jouleswarm.runs.summary import summarise

LABEL = "cellular, 0.9 J a message"
CELLULAR = {"prices": ["literal", "published", "examples.cellular:Cellular"]}


def with_prices(scenario: Scenario, **energy: Any) -> Scenario:
    return scenario_from({**scenario.model_dump(mode="json"), "energy": CELLULAR | energy}, "made-up")


@pytest.fixture
def path(write_run: Callable[..., Path], facts: Any) -> Path:
    facts.rows[:] = [row if row.learned is None else row.model_copy(update={"learned": True}) for row in facts.rows]
    scenario = with_prices(facts.scenario)
    return write_run(summarise(scenario, facts.rows, facts.meter_rows), energy=CELLULAR)


@pytest.fixture
def run(path: Path) -> Run:
    return load_run(path)


def test_it_has_a_column_of_every_table(run: Run) -> None:
    energy = run.scenario.energy
    totals = totals_table(run, energy)
    assert totals.headings == [
        "arm", "paper (its t0)", "published prices", "Table I sizes", "scenario sizes", "counted payload",
        "counted packets", LABEL,
    ]  # fmt: skip
    assert [row[-1] for row in totals.rows] == ["3.296 kJ", "2.453 kJ"]  # 3187.92 + 108 J, 2452.8 J
    parts = energy_table(run, "maml", energy)
    assert parts.headings[-1] == LABEL
    # up 4.8 + 108 J, down 0.8 J; the rest as by the equations
    assert [row[-1] for row in parts.rows] == [
        "2.365 kJ", "113.6 J", "2.478 kJ", "816 J", "1.6 J", "817.6 J", "3.296 kJ",
    ]  # fmt: skip


def test_it_has_tables_by_cause_and_by_site_of_its_own(run: Run) -> None:
    energy = run.scenario.energy.model_copy(update={"robots_g_per_kwh": 360.0})  # 0.0001 g a joule
    ours, its = causes_tables(run, energy)
    assert (ours.title, its.title) == ("Counted payload: E by cause", f"{LABEL}: E by cause")
    assert its.rows[0][1:] == ["2.365 kJ", "816 J", "112.8 J", "0.8 J", "1.6 J", "3.296 kJ"]
    assert its.rows[1] == ours.rows[1]
    _, sites = sites_tables(run, energy)
    assert sites.title == f"{LABEL}: E and gCO2e by site"
    # robots: 816 + 112.8 + 1.6 J
    assert sites.rows[0][1:] == ["2.366 kJ", "930.4 J", "unknown", "0.09304 g", "unknown"]


def test_control_would_cost_what_it_says(run: Run) -> None:
    table = bytes_table(run, run.scenario.energy)
    assert table.headings[-2:] == ["would cost", f"would cost, {LABEL}"]
    (control,) = [row for row in table.rows if row[0] == "MAML, t0 = 3: control"]
    assert control[-2:] == ["0.028 J", "0.928 J"]  # one message of telemetry goes up


def test_answer_and_notes_name_it(run: Run) -> None:
    energy = run.scenario.energy
    (line,) = [words for what, words in said(run, energy, answer(run, energy)).lines if what == "prices"]
    assert f"1.3 times by {LABEL}" in line  # 3295.92 / 2452.8
    assert f"{LABEL} (examples.cellular:Cellular)." in " ".join(notes(run, run.scenario.energy))


def test_it_has_a_row_of_the_energy_figure(run: Run) -> None:
    _, tasks, total, _, its_tasks, its_total = energy_figure(run, run.scenario.energy).axes
    assert [axes.get_title() for axes in (tasks, its_tasks)] == ["Counted payload", LABEL]
    assert [bar.get_height() for bar in its_total.patches] == pytest.approx([3180.72, 115.2, 2448.0, 4.8])
    assert [bar.get_height() for bar in total.patches] == pytest.approx([3180.72, 7.2, 2448.0, 4.8])
    assert sum(bar.get_height() for bar in its_total.patches) == pytest.approx(3180.72 + 115.2 + 2448 + 4.8)


def test_it_is_in_the_summary_beside_ours(path: Path, facts: Any) -> None:
    summary = json.loads((path / SUMMARY).read_text())
    found = summary["arms"]["maml"]["energy_j"]
    plain = summarise(facts.scenario, facts.rows, facts.meter_rows)["arms"]["maml"]["energy_j"]
    assert {name: found[name] for name in plain} == plain
    assert found["cellular"] == {
        "ml_learning": pytest.approx(2364.72),
        "ml_communication": pytest.approx(113.6),
        "fl_learning": pytest.approx(816.0),
        "fl_communication": pytest.approx(1.6),
        "total": pytest.approx(3295.92),
        "by_cause": pytest.approx(
            {
                "computing_datacenter": 2364.72,
                "computing_robots": 816,
                "uplink": 112.8,
                "downlink": 0.8,
                "sidelink": 1.6,
            }
        ),
        "by_site": pytest.approx({"datacenter": 2365.52, "robots": 930.4}),
    }
    assert "carbon_g" not in found["cellular"]


def test_its_grams_are_in_the_summary_where_an_intensity_is_given(facts: Any) -> None:
    scenario = with_prices(facts.scenario, robots_g_per_kwh=360.0)
    found = summarise(scenario, facts.rows, facts.meter_rows)["arms"]["maml"]
    assert found["carbon_g"]["robots"] == pytest.approx(0.08224)
    assert found["energy_j"]["cellular"]["carbon_g"]["robots"] == pytest.approx(0.09304)


def test_it_is_on_the_terminal_and_in_the_html(path: Path) -> None:
    console = Console(file=io.StringIO(), width=200)
    (page,) = report(path, details=True, html=True, console=console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert f"{LABEL}: E by cause" in text
    assert page.read_text().count(f"<th>{LABEL}</th>") == 3  # totals, and a table an arm


def test_without_ours_its_own_is_left(path: Path) -> None:
    report(path, changes=['energy.prices=["examples.cellular:Cellular"]'], console=Console(quiet=True))
    priced = load_run(path)
    scenario = scenario_from(
        {**priced.scenario.model_dump(mode="json"), "energy": {"prices": ["examples.cellular:Cellular"]}}, "made-up"
    )
    run = priced.at(scenario)
    assert totals_table(run, scenario.energy).headings == ["arm", "paper (its t0)", LABEL]
    assert [table.title for table in causes_tables(run, scenario.energy)] == [f"{LABEL}: E by cause"]
    assert len(energy_figure(run, scenario.energy).axes) == 3


def test_without_counters_it_has_no_total(write_run: Callable[..., Path]) -> None:
    run = load_run(write_run(energy=CELLULAR))
    assert [row[-1] for row in totals_table(run, run.scenario.energy).rows] == ["-", "-"]


class Fails:
    name, label, calls = "fails", "fails on real facts", 0

    def price(self, facts: Any, energy: Any) -> None:
        if facts.arm:
            raise KeyError(facts.arm)


FAILS = {"prices": ["literal", "tests.report.test_own_prices:Fails"]}
SAID = "price list 'fails': price() fails on arm maml: KeyError: 'maml' (line "


def test_a_list_that_fails_at_the_end_is_told_by_name_and_takes_nothing_with_it(
    write_run: Callable[..., Path], facts: Any
) -> None:
    scenario = scenario_from({**facts.scenario.model_dump(mode="json"), "energy": FAILS}, "made-up")
    summary = summarise(scenario, facts.rows, facts.meter_rows)
    found = summary["arms"]["maml"]["energy_j"]
    assert found["literal"]["total"] == pytest.approx(3187.92)
    assert found["fails"]["error"].startswith(SAID)
    path = write_run(summary, energy=FAILS)
    with pytest.raises(ConfigurationError) as caught:
        report(path, console=Console(quiet=True))
    assert str(caught.value).startswith(SAID)
    report(path, changes=['energy.prices=["literal"]'], console=Console(quiet=True))


def test_flows_and_work_add_up_to_the_counts(run: Run) -> None:
    facts = run.facts["maml"]
    pairs = [("agent-1", "agent-2", 1, 4), ("agent-2", "agent-1", 1, 4), ("agent-3", "agent-4", 2, 6)]
    flows = {(flow.phase, flow.link, flow.sender, flow.receiver): flow for flow in facts.flows}
    assert len(flows) == len(facts.flows) == 2 + 4 + 4
    for sender, receiver, task, messages in pairs:
        assert flows["fl", "sidelink", sender, receiver] == Flow(
            "fl", task, "sidelink", sender, receiver, messages, 5000 * messages, 5040 * messages,
        )  # type: ignore[arg-type]  # fmt: skip
    assert flows["ml", "uplink", "agent-3", "datacenter"][1:2] == (2,)
    assert flows["ml", "uplink", "agent-3", "datacenter"][5:] == (60, 60_000, 66_000)
    assert flows["ml", "downlink", "datacenter", "agent-4"][1:] == (
        STAGE, "downlink", "datacenter", "agent-4", 1, 5000, 5050,
    )  # fmt: skip
    work = {(each.phase, each.task, each.robot): each for each in facts.work}
    assert work["ml", 1, 0] == Work("ml", 1, 0, 30, 30, pytest.approx(1.2), 3)  # 3 rounds of 10 + 10 in 0.4 s
    assert work["ml", 2, 3] == Work("ml", 2, 3, 0, 0, pytest.approx(1.5), 3, 60)  # collected experience for 3 x 0.5 s
    assert work["fl", 2, 4] == Work("fl", 2, 4, 120, 0, pytest.approx(12.0), 6, 120)
    assert len(work) == 2 + 2 + 4
    assert sum(flow.payload_bytes for flow in facts.flows if flow.link == "uplink") == facts.counts.ml.uplink_bytes
    assert sum(each.plain for each in facts.work if each.robot) == facts.counts.fl.gradients_robots
    assert run.packet_facts["maml"].counts.ml.uplink_bytes == 132_000
    assert (facts.t0, facts.rounds, facts.training_robots) == (3, {1: 4, 2: 6}, 2)
