"""Reading, printing and pricing again the made-up run of tests/made_up_run.py."""

import io
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.figure_kinds import KINDS
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.topics import weights
from jouleswarm.energy.closed_form import TABLE_I
from jouleswarm.energy.literal import literal
from jouleswarm.energy.repricing import Prices, reprice
from jouleswarm.report.answer import answer
from jouleswarm.report.format import bytes_text, joules_text
from jouleswarm.report.notes import notes
from jouleswarm.report.report import print_report, report
from jouleswarm.runs.arm_facts import control_facts
from jouleswarm.runs.columns import Column, closed_facts, columns
from jouleswarm.runs.directory import MANIFEST, METER, PROGRESS, ROUNDS, SUMMARY
from jouleswarm.runs.run import load_run
from jouleswarm.runs.summary import summarise


@pytest.fixture
def complete(write_run, facts) -> Path:
    return write_run(summarise(facts.scenario, facts.rows, facts.meter_rows))


@pytest.fixture
def interrupted(write_run) -> Path:
    path = write_run()
    with (path / ROUNDS).open("a") as file:
        file.write('{"phase": "fl", "arm": "ma')
    return path


def contents(path: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in path.iterdir() if file.is_file()}


def printed(path: Path, prices: Prices | None = None, **options: bool) -> str:
    console = Console(file=io.StringIO(), width=160)
    report(path, prices, console=console, **options)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def column(held: list[Column], label: str) -> dict[str, float | None]:
    (found,) = (each.joules for each in held if each.label == label)
    return found


def repriced(energy: Energy, prices: Prices, scenario: Scenario) -> tuple[Energy, str]:
    other, suffix = reprice(scenario.model_copy(update={"energy": energy}), prices.changes, "run")
    return other.energy, suffix


def test_a_complete_run_is_read_whole(complete, facts) -> None:
    run = load_run(complete)
    assert (run.name, run.status, run.t0, run.cut) == ("made-up", "complete", {"maml": 3, "fl": 0}, [])
    assert (len(run.rows), len(run.meter_rows), len(run.progress)) == (len(facts.rows), len(facts.meter_rows), 3)
    assert run.rounds("fl") == {1: 10, 2: 20}


def test_an_interrupted_run_is_read_as_far_as_it_got(interrupted, facts) -> None:
    run = load_run(interrupted)
    assert (run.status, run.cut, run.meter_rows) == ("interrupted", [ROUNDS], [])
    assert len(run.rows) == len(facts.rows)


def test_a_run_that_was_killed_has_the_counters_that_its_processes_have_kept(interrupted, facts) -> None:
    state, topic = interrupted / "state", weights("made-up", "fl", 1, 1)
    Meter("broker", state / "broker").count("agent-2", topic, "out", 5000, 5040)
    Meter("broker", state / "broker").count("agent-2", weights("another", "fl", 1, 1), "out", 5000, 5040)
    for client, direction in (("agent-1", "out"), ("agent-2", "in")):
        Meter("client", state / client).count(client, topic, direction, 5000, 5040)
    (state / "agent-3").mkdir()  # killed before it had counted anything
    told = [(row.side, row.client, row.direction, row.packet_bytes) for row in load_run(interrupted).meter_rows]
    assert told == [
        ("broker", "agent-2", "out", 5040), ("client", "agent-1", "out", 5040), ("client", "agent-2", "in", 5040)
    ]  # fmt: skip
    assert "bytes were not counted" not in printed(interrupted)


def test_an_interrupted_run_prints_what_is_known(interrupted) -> None:
    text = printed(interrupted)
    assert "No verdict: the run is interrupted" in text
    assert "bytes were not counted" in text
    assert "2.365 kJ" in text  # MAML learning is known from the rows
    assert "No byte counters were written" in printed(interrupted, details=True)


def test_unmetered_columns_are_empty_and_closed_form_is_not(interrupted) -> None:
    run = load_run(interrupted)
    counted = column(columns(run, "maml", run.scenario.energy), "counted payload")
    assert (counted["ml_learning"], counted["total"]) == (pytest.approx(2364.72), None)
    held = {column.label: column.joules["total"] for column in columns(run, "maml", run.scenario.energy)}
    assert held["counted payload"] is None
    assert held["scenario sizes"] is not None


def test_a_report_holds_what_was_foretold_against_what_was_counted(complete) -> None:
    (line,) = [each for each in notes(load_run(complete), Energy()) if each.startswith("Foretold and counted")]
    # a pair's weights: 2 x 1,391,268 float32 by the closed form, 2 x 5000 bytes in this made-up run
    assert "FL, no transfer, fl sidelink 11.13 MB and 10 kB (0.0009)" in line
    assert "MAML, t0 = 3, ml uplink 49.15 MB and 40 kB (0.0008)" in line


def test_a_run_with_no_rows_yet_is_printed(write_run, facts) -> None:
    facts.rows.clear()
    path = write_run()
    assert "interrupted" in printed(path)


def test_no_such_directory() -> None:
    with pytest.raises(ConfigurationError, match="no such directory"):
        load_run("runs/nowhere")


def test_a_directory_that_is_not_a_run(tmp_path) -> None:
    with pytest.raises(ConfigurationError, match=r"has no manifest\.json"):
        load_run(tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        (MANIFEST, "{", "cannot be read"),
        (MANIFEST, "[]", "expected a JSON object"),
        (MANIFEST, '{"schema": 3}', "run directory of schema 3, this version reads 2"),
        (MANIFEST, '{"schema": 1}', "schema 1, from before runs had an arm for each method; this version reads 2"),
        (MANIFEST, "{}", "run directory of schema None"),
        (MANIFEST, '{"schema": 2, "run": "x"}', "no 'scenario'"),
        (MANIFEST, '{"schema": 2, "run": "x", "scenario": {}}', "damaged"),
        (MANIFEST, '{"schema": ' + "[" * 20_000 + "]" * 20_000 + "}", "nested too deeply"),
        (SUMMARY, "{", "cannot be read"),
        (SUMMARY, "{}", "damaged, its status is None, expected complete, interrupted, failed"),
        (ROUNDS, '{"phase": "fl"}\n{}\n', "line 1: damaged"),
        (METER, '{"side": "bro', "line 1: damaged"),
        (PROGRESS, "{}\n", "line 1: damaged"),
    ],
)
def test_a_damaged_file_is_named(complete, name: str, content: str, says: str) -> None:
    (complete / name).write_text(content)
    with pytest.raises(RunError, match=re.escape(says)) as caught:
        load_run(complete)
    assert name in str(caught.value)


def test_a_row_that_stands_twice_is_refused_and_not_billed_twice(complete) -> None:
    lines = (complete / ROUNDS).read_text().splitlines(keepends=True)
    (complete / ROUNDS).write_text("".join([*lines, lines[2]]))
    with pytest.raises(RunError, match=rf"rounds\.jsonl, line {len(lines) + 1}: round .* stands in line 3 already"):
        load_run(complete)


def test_a_manifest_that_says_nothing_of_its_host_is_reported(complete) -> None:
    manifest = json.loads((complete / MANIFEST).read_text()) | {"host": None, "versions": None, "started": None}
    (complete / MANIFEST).write_text(json.dumps(manifest))
    report(complete, console=Console(quiet=True))


def test_rows_of_a_later_version_are_not_called_damaged(complete) -> None:
    manifest = json.loads((complete / MANIFEST).read_text())
    manifest["versions"]["jouleswarm"] = "0.9.0"
    (complete / MANIFEST).write_text(json.dumps(manifest))
    load_run(complete)  # what it can read, it reads
    rows = [json.loads(line) | {"loss": 0.1} for line in (complete / ROUNDS).read_text().splitlines()]
    (complete / ROUNDS).write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(RunError) as error:
        load_run(complete)
    assert str(error.value) == (
        f"{complete}: written by version 0.9.0 of JouleSwarm, this is 0.1.0, which cannot read it; report it with the "
        "version that wrote it"
    )


def test_figures_that_cannot_be_written_are_told_with_the_folder(complete) -> None:
    (complete / "figures").touch()
    with pytest.raises(RunError, match=r"run directory .*: File exists \(.*/figures\)"):
        report(complete, figures=KINDS, console=Console(quiet=True))


def test_a_finished_run_must_have_its_rounds(complete) -> None:
    (complete / ROUNDS).unlink()
    with pytest.raises(RunError, match=r"rounds\.jsonl: missing"):
        load_run(complete)


def test_columns_side_by_side(complete) -> None:
    run = load_run(complete)
    held = columns(run, "maml", run.scenario.energy)
    found = {column.label: column.joules for column in held}
    # of the paper's own scenario and deployment only: see test_many_arms.py
    assert (found["paper"]["total"], found["published prices"]["total"]) == (None, None)
    # 3 rounds x 2 robots x (20 x 1.67 x 11.8 J + 984 J) + 4 x 224 J + 10 rounds x 260.8 J
    assert found["Table I sizes"]["total"] == pytest.approx(6 * (394.12 + 984) + 896 + 2608)
    assert found["counted payload"]["total"] == pytest.approx(3187.92)
    # packets: up 132,000 B, down 20,200 B at 200 kb/J, sidelinks 100,800 B at 500 kb/J
    assert found["counted packets"]["ml_communication"] == pytest.approx(5.28 + 0.808)
    assert found["counted packets"]["fl_communication"] == pytest.approx(1.6128)


def test_scenario_sizes_of_a_paper_size_scenario_are_near_table_i(complete) -> None:
    run = load_run(complete)
    ours = literal.price(closed_facts(run, "maml"), run.scenario.energy).total_j
    papers = literal.price(closed_facts(run, "maml", TABLE_I), run.scenario.energy).total_j
    assert ours == pytest.approx(papers, rel=0.01)


def test_control_is_priced_apart(complete) -> None:
    run = load_run(complete)
    # 4 x 100 B down and 300 B to the recorder, both at 200 kb/J
    control = control_facts(run.facts["maml"], run.meter_rows)
    assert literal.price(control, run.scenario.energy).total_j == pytest.approx(0.028)
    told = sorted((flow.link, flow.receiver, flow.messages, flow.payload_bytes) for flow in control.flows)
    assert told == [*(("downlink", f"agent-{each}", 1, 100) for each in (1, 2, 3, 4)), ("uplink", "recorder", 1, 300)]


def test_pricing_again_scales_communication_only(complete) -> None:
    run = load_run(complete)
    energy, suffix = repriced(run.scenario.energy, Prices(ul=500, sl=200), run.scenario)
    parts = column(columns(run, "maml", energy), "counted payload")
    assert suffix == "-ul500-sl200"
    assert parts["ml_communication"] == pytest.approx(2.24)  # 140,000 B x 8 / 500 kb/J
    assert parts["fl_communication"] == pytest.approx(4.0)  # 100,000 B x 8 / 200 kb/J
    assert parts["ml_learning"] == pytest.approx(2364.72)
    assert {column.label: column.joules["total"] for column in columns(run, "maml", energy)}["published prices"] is None


def test_the_same_prices_are_no_repricing(facts) -> None:
    assert repriced(Energy(), Prices(ul=200, sl=500, pue=1.67), facts.scenario) == (Energy(), "")


def test_every_price_can_be_changed(facts) -> None:
    prices = Prices(dl=100, pue=1.2, beta=2, carbon_datacenter=350, carbon_robots=0, via_base_station=True)
    energy, suffix = repriced(Energy(), prices, facts.scenario)
    assert (energy.dl_bit_per_j, energy.pue, energy.beta, energy.sidelink) == (100e3, 1.2, 2, "via_base_station")
    assert (energy.datacenter_g_per_kwh, energy.robots_g_per_kwh) == (350, 0)
    assert suffix == "-dl100-pue1.2-beta2-carbon-datacenter350-carbon-robots0-via-base-station"


@pytest.mark.parametrize(
    ("option", "value", "says"),
    [
        ("ul", 0.0, "--ul 0: expected a number from 1e-09 to 1e+12, in kb/J"),
        ("sl", -5.0, "--sl -5: expected"),
        ("dl", float("nan"), "--dl nan: expected"),
        ("pue", 0.9, "--pue 0.9: expected a number of 1 or more"),
        ("beta", float("inf"), "--beta inf: expected"),
        ("carbon_robots", -1.0, "--carbon-robots -1: expected a number of 0 or more, up to 1e+06, in gCO2e a kWh"),
    ],
)
def test_a_price_that_is_no_price(option: str, value: float, says: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(says)):
        _ = Prices(**{option: value}).changes


def test_pricing_again_leaves_the_run_as_it_was(complete) -> None:
    before = contents(complete)
    text = printed(complete, Prices(ul=500, sl=200), figures=KINDS, html=True)
    # 3187.92 J: links 5.6 + 1.6 to 2.24 + 4 J; 2452.8 J: sidelinks 4.8 to 12 J
    assert "At these prices: MAML 3.188 to 3.187 kJ, FL, no transfer 2.453 to 2.46 kJ" in text.splitlines()[1]
    assert "E_UL 500" in printed(complete, Prices(ul=500, sl=200), details=True)
    after = contents(complete)
    assert after.pop("report-ul500-sl200.html")
    assert after == before
    assert sorted(file.name for file in (complete / "figures").iterdir()) == [
        *("energy-ul500-sl200.png", "energy-ul500-sl200.svg"),
        *("learned-ul500-sl200.csv", "learned-ul500-sl200.png", "learned-ul500-sl200.svg"),
    ]


@pytest.fixture
def learned(write_run, facts) -> Path:
    """As the made-up run, but task 2 was learned without transfer too, in its last round."""
    facts.rows[:] = [row if row.learned is None else row.model_copy(update={"learned": True}) for row in facts.rows]
    return write_run(summarise(facts.scenario, facts.rows, facts.meter_rows))


def test_no_verdict_on_what_was_not_learned(complete) -> None:
    run = load_run(complete)  # task 2 was not learned without transfer
    assert answer(run, run.scenario.energy).against == ()
    assert "there is no verdict on these arms" in printed(complete, details=True)


@pytest.mark.parametrize("status", ["interrupted", "failed", None])
def test_no_verdict_on_a_run_that_is_not_complete(learned, status: str | None) -> None:
    if status is None:
        (learned / SUMMARY).unlink()
    else:
        summary = json.loads((learned / SUMMARY).read_text())
        (learned / SUMMARY).write_text(json.dumps({**summary, "status": status}))
    run = load_run(learned)
    assert answer(run, run.scenario.energy).against == ()


def spoilt(path: Path) -> None:
    """One delivery of weights less in the broker's counters than robot 2 has received."""
    rows = [json.loads(line) for line in (path / METER).read_text().splitlines()]
    for row in rows:
        if (row["side"], row["client"], row["direction"]) == ("broker", "agent-2", "out") and "/fl/sl/" in row["topic"]:
            row["messages"] -= 1
            row["payload_bytes"] -= 5000
    (path / METER).write_text("".join(json.dumps(row) + "\n" for row in rows))


def test_counters_that_do_not_fit_are_said_first_and_are_an_error(learned) -> None:
    spoilt(learned)
    console = Console(file=io.StringIO(), width=500)
    with pytest.raises(RunError, match="run: The counters of broker and clients do not fit for 1 client and topic"):
        report(learned, html=True, console=console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert text.startswith("The counters of broker and clients do not fit for 1 client and topic pairs, first agent-2")
    assert "is not to be trusted" in text
    assert "No verdict: the counters of broker and clients contradict each other" in text
    page = (learned / "report.html").read_text(encoding="utf-8")
    assert page.index("do not fit") < page.index("<h1>")


def test_counters_of_a_run_cut_short_are_not_final(learned) -> None:
    spoilt(learned)
    summary = json.loads((learned / SUMMARY).read_text())
    (learned / SUMMARY).write_text(json.dumps({**summary, "status": "interrupted", "counters": "the broker's"}))
    assert "No verdict: the run is interrupted" in printed(learned)
    assert "do not fit" in printed(learned, details=True)


def test_the_report_says_whose_counters_feed_the_bill(write_run, facts) -> None:
    summary = summarise(
        facts.scenario, facts.rows, facts.meter_rows, source="the broker's counters, from the beginning"
    )
    assert "Metered by the broker's counters, from the beginning." in printed(write_run(summary), details=True)


def test_no_verdict_on_one_arm(write_run, facts) -> None:
    run = load_run(write_run(summarise(facts.scenario, facts.rows, facts.meter_rows), methods=["fl"]))
    assert answer(run, run.scenario.energy).against == ()
    print_report(run, console=Console(file=io.StringIO()))


def test_notes_tell_what_is_missing(complete, facts) -> None:
    run = load_run(complete)
    text = " ".join(notes(run, run.scenario.energy))
    assert "Not learned: task 2 by FL, no transfer." in text
    assert "Published prices are not defined here" in text
    text = " ".join(notes(run, Energy(sl_bit_per_j=200e3, dl_bit_per_j=1e5)))
    assert "(200, 500) kb/J only" in text
    assert "E_DL is not given" not in text


def test_a_run_metered_by_its_clients_says_so(write_run, facts) -> None:
    facts.meter_rows[:] = [row for row in facts.meter_rows if row.side == "client"]
    run = load_run(write_run(summarise(facts.scenario, facts.rows, facts.meter_rows)))
    assert any("Metered by the clients" in line for line in notes(run, run.scenario.energy))


def test_html_is_one_file_with_everything_in_it(complete) -> None:
    (path,) = report(complete, html=True, console=Console(file=io.StringIO()))
    text = path.read_text(encoding="utf-8")
    assert path.name == "report.html"
    assert text.count("<svg") == 5 + 2 + 1  # figures, maps, and who is linked to whom
    assert not re.search(r"""(src|href)=["']?(https?:|//|data:)|@import|<script src|<link""", text)
    assert "currentColor" in text
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    used = set(re.findall(r'href="#([^"]+)"', text)) | set(re.findall(r"url\(#([^)]+)\)", text))
    assert {each for each in used if not each.startswith("cause-")} <= set(ids)  # those the script makes


def test_html_escapes_what_came_from_outside(complete) -> None:
    manifest = json.loads((complete / MANIFEST).read_text())
    manifest["run"] = hostile = "</script><b>x</b>"
    manifest["scenario"]["note"] = "{{ 7 * 7 }}" + hostile
    (complete / MANIFEST).write_text(json.dumps(manifest))
    (path,) = report(complete, html=True, console=Console(file=io.StringIO()))
    text = path.read_text(encoding="utf-8")
    assert "<b>x</b>" not in text
    assert "{{ 7 * 7 }}" in text  # of the template's language too nothing is taken for more than text
    assert text.count("</script>") == 2


@pytest.mark.parametrize(
    ("size", "text"), [(0, "0 B"), (999, "999 B"), (5_565_072, "5.565 MB"), (24_600, "24.6 kB"), (3.1e9, "3.1 GB")]
)
def test_bytes_as_text(size: float, text: str) -> None:
    assert bytes_text(size) == text


@pytest.mark.parametrize(
    ("joules", "text"),
    [
        (None, "-"),
        (0.0, "0 J"),
        (5.6, "5.6 J"),
        (999.0, "999 J"),
        (1234.56, "1.235 kJ"),
        (106e3, "106 kJ"),
        (1.5e6, "1.5 MJ"),
    ],
)
def test_joules_as_text(joules: float | None, text: str) -> None:
    assert joules_text(joules) == text


def test_a_report_that_draws_nothing_does_not_load_what_draws(complete: Path) -> None:
    code = f"""
import sys
from jouleswarm.cli.main import app
app(["report", {str(complete)!r}, "--details", "--why"], standalone_mode=False)
print({{"matplotlib", "pandas", "torch"}} & set(sys.modules))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"
