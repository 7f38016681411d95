"""Reports, figures and bills of a made-up run of all nine methods, five of them from two meta-models: 14 arms.

6 tasks x 2 robots. Every arm learned task i in 2 i rounds (42 in all) of 20 gradients a robot, but isolated robots
nothing and centralized learning all but task 6. Meta-learning: 6 rounds on 2 tasks, 10 + 10 gradients and 20,000 B up
a task and round. Sidelinks: one message of 5000 B a round and task. Nothing else was sent.
"""

from __future__ import annotations

import io
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.energy.repricing import Prices
from jouleswarm.methods.shipped import all_shipped
from jouleswarm.report.answer import answer, said
from jouleswarm.report.bars import energy_figure, rounds_figure
from jouleswarm.report.curves import rewards_figure
from jouleswarm.report.notes import headline, notes
from jouleswarm.report.report import print_report, report
from jouleswarm.report.table import Cell, Table
from jouleswarm.report.tables import bytes_table, causes_tables, rounds_table, sites_tables, totals_table
from jouleswarm.runs.columns import columns
from jouleswarm.runs.directory import RunDirectory
from jouleswarm.runs.manifest import manifest
from jouleswarm.runs.run import Run, load_run
from jouleswarm.runs.summary import summarise

RUN = "many"
T0 = 6
TASKS = range(1, 7)


def _scenario() -> Scenario:
    tasks = [{"id": task, "map": "E*\n.X"} for task in TASKS]
    meta = {"t0": T0, "training_tasks": [1, 2], "adapt_from": [2]}
    data = {"name": RUN, "world": {"rows": 2, "cols": 2}, "tasks": tasks, "methods": list(all_shipped()), "meta": meta}
    return scenario_from(data, RUN)


def _write(path: Path) -> Path:
    scenario, meter, rows = _scenario(), Meter("broker"), []
    for method in (name for name, each in all_shipped().items() if each.stage):
        rows += _stage(method, meter)
    for arm in scenario.arm_names:
        for task, (first, second) in scenario.clusters.items():
            learned = arm != "isolated" and (arm, task) != ("centralized", 6)
            for round_ in range(1, 2 * task + 1):
                rows += [
                    RoundRow(
                        phase="fl", arm=arm, task=task, agent=agent, round=round_, seconds=0.1, gradients=20,
                        reward=30.0 * round_ / task, cluster_reward=27.5 * round_ / task if learned else 5.0,
                        rmse_m=0.5, learned=learned if round_ == 2 * task else None,
                    )
                    for agent in (first, second)
                ]  # fmt: skip
                if arm not in ("isolated", "fedavg", "centralized"):
                    meter.count(f"agent-{second}", topics.weights(RUN, arm, task, first), "out", 5_000, 5_040)
    directory = RunDirectory(path)
    directory.manifest(manifest(scenario, RUN, "mqtt://localhost:1883", embedded=True))
    for row in rows:
        directory.round(row)
    directory.meter(meter.rows())
    directory.summary(summarise(scenario, rows, meter.rows()))
    return path


def _stage(method: str, meter: Meter) -> list[RoundRow]:
    rows = []
    for round_ in range(1, T0 + 1):
        for task, agent in ((1, 1), (2, 3)):
            rows.append(
                RoundRow(
                    phase="maml", arm=method, task=task, agent=0, round=round_, seconds=0.1, gradients=20,
                    gradients_support=10, gradients_query=10, experience_bytes=20_000,
                )
            )  # fmt: skip
            meter.count("datacenter", topics.experience(RUN, method, task, agent), "out", 20_000, 22_000)
    return rows


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return load_run(_write(tmp_path_factory.mktemp("many") / "run"))


MEASURES = ("by full window", "by partial window", "at t_i = 0")


def rows_of(table: Table) -> dict[Cell, list[Cell]]:
    return {row[0]: list(row[1:]) for row in table.rows}


def test_rounds_have_a_row_an_arm_with_its_own_t0(run: Run) -> None:
    table = rounds_table(run)
    assert table.headings == ["arm", "t0", *(f"t_{task}" for task in TASKS), "sum of t_i", *MEASURES]
    found = rows_of(table)
    assert len(found) == 14
    # the first two tasks end before a window of 5 rounds is full; R of task 6 is 27.5 x 11 / 6 = 50.4 in round 11
    assert found["MAML, t0 = 2"] == ["2", "2", "4", "6", "8", "10", "12", "42", "-", "41", "0%"]
    assert found["MAML, t0 = 6"][0] == "6"
    assert found["FL, no transfer"][0] == "0"
    assert found["centralized"][6] == "12 ×"
    assert found["isolated robots"][1:7] == ["2 ×", "4 ×", "6 ×", "8 ×", "10 ×", "12 ×"]


def test_of_many_arms_the_worst_path_error_is_told(run: Run) -> None:
    energy = run.scenario.energy
    lines = dict(said(run, energy, answer(run, energy)).lines)
    assert lines["path error"] == "RMSE at the end at most 0.50 m, of the worst task of all arms"


def test_causes_of_an_arm_from_an_earlier_meta_model(run: Run) -> None:
    found = rows_of(causes_tables(run, run.scenario.energy)[0])
    # data center 2 rounds x 2 tasks x 20 x 1.67 x 11.8 J; robots 42 x 2 x 20 x 2.04 J; up 4 x 20,000 B x 8 / 200 kb/J;
    # sidelinks 42 x 5000 B x 8 / 500 kb/J
    assert found["Reptile, t0 = 2"] == ["1.576 kJ", "3.427 kJ", "3.2 J", "0 J", "3.36 J", "5.01 kJ"]
    assert found["Reptile, t0 = 6"] == ["4.729 kJ", "3.427 kJ", "9.6 J", "0 J", "3.36 J", "8.17 kJ"]
    assert found["isolated robots"] == ["0 J", "3.427 kJ", "0 J", "0 J", "0 J", "3.427 kJ"]


def test_sites_have_grams_only_where_an_intensity_is_given(run: Run) -> None:
    energy = run.scenario.energy
    assert sites_tables(run, energy)[0].headings == ["arm", "data center", "robots"]
    energy = energy.model_copy(update={"datacenter_g_per_kwh": 360.0})  # 0.0001 g a joule
    table = sites_tables(run, energy)[0]
    assert table.headings[3:] == ["gCO2e, data center", "gCO2e, robots", "gCO2e, both"]
    assert rows_of(table)["ANIL, t0 = 6"] == ["4.729 kJ", "3.44 kJ", "0.4729 g", "unknown", "unknown"]
    both = energy.model_copy(update={"robots_g_per_kwh": 36.0})
    # robots 3427.2 + 9.6 + 3.36 J at 0.00001 g
    assert rows_of(sites_tables(run, both)[0])["ANIL, t0 = 6"][2:] == ["0.4729 g", "0.0344 g", "0.5073 g"]


def test_headline_tells_the_intensities_that_are_known(run: Run) -> None:
    energy = run.scenario.energy
    assert "gCO2e" not in headline(run, energy)
    energy = energy.model_copy(update={"robots_g_per_kwh": 50.0})
    assert headline(run, energy).endswith("; gCO2e/kWh: data center unknown, robots 50")
    assert any("unknown, not zero" in line for line in notes(run, energy))


def elsewhere(run: Run, **changes: Any) -> Run:
    """The same rows, as of a scenario with other settings."""
    resolved = run.scenario.model_dump(mode="json")
    for section, fields in changes.items():
        resolved[section] = resolved[section] | fields if isinstance(fields, dict) else fields
    return replace(run, scenario=scenario_from(resolved, RUN))


PAPERS = {"meta": {"training_tasks": [1, 2, 6]}}  # its Q = 3 tasks; all else is the default


def test_the_paper_says_something_of_its_own_methods_only(run: Run) -> None:
    papers = elsewhere(run, **PAPERS)
    for arm in run.scenario.arms:
        held = {column.label: column.joules["total"] for column in columns(papers, arm.name, run.scenario.energy)}
        assert (held["paper"] is not None) == (arm.method in ("fl", "maml", "fomaml"))
        # its prices a round also hold for rounds that move and compute as much
        assert (held["published prices"] is not None) == (all_shipped()[arm.method].partners == "neighbours")
        assert held["scenario sizes"] is not None
    # 2 x 352.4 J + 42 x 246.3 J
    assert rows_of(totals_table(papers, run.scenario.energy))["MAML, t0 = 2"][:2] == ["106 kJ (210)", "11.05 kJ"]


@pytest.mark.parametrize(
    "changes",
    [
        {"meta": {"training_tasks": [1, 2]}},
        {"meta": {"training_tasks": [1, 2, 6], "robots_per_task": 2}},
        {**PAPERS, "federation": {"robots_per_cluster": 3}},
    ],
)
def test_published_prices_are_of_the_papers_deployment_only(run: Run, changes: dict[str, Any]) -> None:
    other = elsewhere(run, **changes)
    assert rows_of(totals_table(other, run.scenario.energy))["MAML, t0 = 2"][:2] == ["-", "not defined here"]
    text = " ".join(notes(other, run.scenario.energy))
    assert "Published prices are not defined here: they are the paper's deployment's, 3 training robots" in text


@pytest.mark.parametrize(
    "changes",
    [
        {"meta": {"training_tasks": [1, 2, 3]}},
        {**PAPERS, "learning": {"batches_per_round": 10}},
        {**PAPERS, "network": {"width": 48, "height": 36}},
        {**PAPERS, "camera": {"width": 64, "height": 48}},
        {**PAPERS, "energy": {"pk_w": 2.0}},
    ],
)
def test_the_papers_own_totals_stand_beside_its_own_scenario_only(run: Run, changes: dict[str, Any]) -> None:
    other = elsewhere(run, **changes)
    first, published = rows_of(totals_table(other, other.scenario.energy))["MAML, t0 = 2"][:2]
    assert (first, published) == ("-", "11.05 kJ")


def test_isolated_robots_have_the_closed_form_of_their_own_rounds(run: Run) -> None:
    held = columns(run, "isolated", run.scenario.energy)
    assert [column.joules["total"] for column in held[2:]] == pytest.approx([3427.2] * 4)  # 84 x 20 x 2.04 J


def test_links_without_traffic_are_left_out_of_the_bytes(run: Run) -> None:
    found = rows_of(bytes_table(run, run.scenario.energy))
    assert found["MAML, t0 = 6: uplink"][:2] == ["12", "240 kB"]
    assert "MAML, t0 = 2: uplink" not in found  # metered once, under the method's own arm
    assert not any(name.startswith("isolated") for name in found)


def test_every_arm_that_learned_all_is_held_against_learning_without_transfer(run: Run) -> None:
    found = answer(run, run.scenario.energy)
    told = {each.arm: each.factor for each in found.against}
    assert "isolated" not in told
    assert "centralized" not in told  # which did not learn task 6
    assert len([arm for arm in told if found.arms[arm].t0]) == 10
    assert told["multitask-t2"] == pytest.approx((1576.48 + 3427.2 + 3.2 + 3.36) / (3427.2 + 3.36))


@pytest.mark.parametrize("width", [60, 80])
def test_the_answer_of_many_arms_has_a_row_each_and_is_not_cut(run: Run, width: int) -> None:
    console = Console(file=io.StringIO(), width=width)
    print_report(run, console=console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "costs least of the 12 of 14 arms that learned all tasks" in " ".join(text.replace("│", " ").split())
    assert re.search(r"multitask, t0 = 2 +6 of 6 +2 \+ 42 +5\.01 kJ +1\.5", text)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width


def test_notes_tell_how_arms_are_charged(run: Run) -> None:
    text = " ".join(notes(run, run.scenario.energy))
    assert "Not learned: tasks 1, 2, 3, 4, 5, 6 by isolated robots; task 6 by centralized." in text
    assert "share its meta-learning" in text
    assert "have no E_ML" in text
    assert "Isolated robots stop one by one" in text


def test_a_terminal_shows_many_arms_without_a_table_for_each(run: Run) -> None:
    console = Console(file=io.StringIO(), width=120)
    report(run.path, Prices(carbon_datacenter=350, carbon_robots=50), details=True, console=console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "E and gCO2e by site" in text
    assert "Energy: MAML" not in text
    assert not re.search(r"^ *\S*…", text, re.MULTILINE)  # no label is cut


def test_html_has_a_table_for_each_of_many_arms(run: Run) -> None:
    (path,) = report(run.path, Prices(carbon_robots=50), html=True, console=Console(file=io.StringIO()))
    text = path.read_text(encoding="utf-8")
    assert path.name == "report-carbon-robots50.html"
    assert text.count("<h2>Energy: ") == 14
    assert ">unknown</td>" in text
    assert "gCO2e, both" in text


def test_bars_of_many_arms_stand_apart_and_in_their_groups(run: Run) -> None:
    for draw in (energy_figure, rounds_figure):
        axes = draw(run, run.scenario.energy).axes[0]
        sides = sorted({(round(bar.get_x(), 6), round(bar.get_x() + bar.get_width(), 6)) for bar in axes.patches})
        assert all(left[1] <= right[0] + 1e-5 for left, right in pairwise(sides))
        assert all(round(left) == round(right) for left, right in sides)  # groups are at 0, 1, 2, ...


def test_with_many_arms_only_unlearned_tasks_are_marked(run: Run) -> None:
    _, axes = rounds_figure(run, run.scenario.energy).axes
    assert [text.get_text().strip() for text in axes.texts if text.get_text()] == ["×"] * 7


def test_curves_of_many_arms_leave_out_single_robots(run: Run) -> None:
    first = rewards_figure(run, run.scenario.energy).axes[0]
    assert len(first.lines) == 14 + 14 + 1  # an R and an end for each arm, and the target
