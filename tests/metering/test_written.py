"""The run directory of a meter: what it holds, what is read back, and what it costs."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from rich.console import Console

from jouleswarm.api import Run
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.meter.tally import Row, Tally, rows_of
from jouleswarm.common.wire.rules import Rule, read_rules
from jouleswarm.fleet.deploy import resume_deployment
from jouleswarm.metering.directory import BILL, MANIFEST, METER, SUMMARY, WINDOWS, Directory
from jouleswarm.metering.exporter import MeterCollector
from jouleswarm.metering.metered import Metered, load_metered
from jouleswarm.metering.recorder import Recorder
from jouleswarm.metering.windows import Windows
from jouleswarm.metering.written import bill_csv, unmatched
from jouleswarm.report.calculated import calculate
from jouleswarm.report.metered import metered_tables, sorted_table, watched_table
from jouleswarm.report.report import report

LINKS = """\
"up/+arm" = { link = "uplink" }
"peers/+sender" = [{ link = "uplink", receiver = "server*" }, { link = "sidelink" }]
"model" = { link = "downlink", phase = "ml" }
"never" = { link = "control" }
"""


@pytest.fixture
def rules(tmp_path: Path) -> list[Rule]:
    (tmp_path / "links.toml").write_text(LINKS)
    return read_rules(tmp_path / "links.toml")


@pytest.fixture
def rows(rules: list[Rule]) -> list[Row]:
    tally = Tally()
    tally.count("r1", "up/fl", ("in", "publish"), 100, 110)
    tally.count("r1", "up/fl", ("in", "publish"), 100, 110)
    tally.count("r1", "up/fl", ("in", "repeat"), 100, 110)
    tally.count("server", "up/fl", ("out", "publish"), 200, 220)
    tally.count("r1", "peers/r1", ("in", "publish"), 1000, 1010)
    for receiver in ("r2", "r3", "server"):
        tally.count(receiver, "peers/r1", ("out", "publish"), 1000, 1010)
    tally.count("server", "model", ("in", "publish"), 5000, 5010)
    tally.count("r2", "model", ("out", "publish"), 5000, 5010)
    tally.count("r2", "who/knows", ("in", "publish"), 7, 20)
    tally.count("r2", "", ("in", "control"), 0, 14)
    return rows_of(tally.counts(), rules)


@pytest.fixture
def left(tmp_path: Path, rows: list[Row]) -> Path:
    """A whole directory: all that passed did so in the first of two windows, but for the model down."""
    windows = Windows(1000.0, 60.0)
    windows.add(1001.0, [row for row in rows if row.link != "downlink"])
    windows.add(1070.0, rows)
    with Directory(tmp_path / "one", tmp_path / "links.toml", None, ["energy.dl_bit_per_j=8e3"]) as directory:
        directory.write(rows, windows.all())
        directory.end()
    return directory.path


def seen(rows: list[Row], rules: list[Rule]) -> Metered:
    """As if it were read."""
    return Metered(Path("one"), {"run": "one", "energy": {"dl_bit_per_j": 8e3}, "robots": []}, rows, rules)


def test_bytes_are_priced_by_the_link_of_their_rule(tmp_path: Path, rules: list[Rule], rows: list[Row]) -> None:
    (tmp_path / BILL).write_text(bill_csv(rows, rules))
    assert (tmp_path / BILL).read_text().splitlines()[1:] == [
        "# robot 1 is 'r1'",
        "# robot 2 is 'r2'",
        "# robot 3 is 'r3'",
        "arm,phase,robot,to,what,value",
        ",fl,1,,sidelink_sent_bytes,1000",
        ",fl,1,,uplink_bytes,1000",  # of peers/r1, as the server got it
        ",fl,1,,uplink_messages,1",
        ",fl,1,2,sidelink_bytes,1000",
        ",fl,1,2,sidelink_messages,1",
        ",fl,1,3,sidelink_bytes,1000",
        ",fl,1,3,sidelink_messages,1",
        ",ml,2,,downlink_bytes,5000",
        ",ml,2,,downlink_messages,1",
        "fl,fl,1,,uplink_bytes,200",  # as r1 sent it
        "fl,fl,1,,uplink_messages,2",
    ]
    found = calculate(tmp_path / BILL, None, ["energy.prices=['literal']"])
    ((bills, *_),) = [list(each.values()) for each in found.bills.values()]
    # Table I: 200 kb/J up and down, 500 kb/J between robots.
    assert bills is not None
    assert bills.fl.uplink_j == pytest.approx(8 * 1200 / 200e3)
    assert bills.fl.sidelink_j == pytest.approx(8 * 2000 / 500e3)
    assert bills.ml.downlink_j == pytest.approx(8 * 5000 / 200e3)


def test_every_row_is_a_line_with_its_rule_and_labels(left: Path) -> None:
    found = {(row["client"], row["topic"]): row for row in map(json.loads, (left / METER).read_text().splitlines())}
    assert found["r1", "up/fl"] == {
        "direction": "in", "kind": "publish", "client": "r1", "topic": "up/fl", "messages": 2, "payload_bytes": 200,
        "packet_bytes": 220, "repeats": 1, "link": "uplink", "phase": "fl", "rule": "up/+arm", "number": 1,
        "labels": {"arm": "fl"},
    }  # fmt: skip
    assert (found["r2", "who/knows"]["link"], found["r2", "who/knows"]["rule"]) == ("other", "")
    assert (found["r2", ""]["kind"], found["r2", ""]["link"]) == ("control", "")


def test_a_rule_that_nothing_came_to_is_told_with_its_count(rules: list[Rule], rows: list[Row]) -> None:
    (never,) = unmatched(rows, rules)
    assert (never.text, never.line) == ("never", 4)
    held = seen(rows, rules)
    table = metered_tables(held, held.priced()[0])[0]
    assert table.rows[0] == ["uplink: up/+arm", "0.008 J", 2, "200 B", 1, "200 B", "440 B", 1]
    assert table.rows[-1][0] == "other: no rule"
    assert table.notes[0] == "never (control), line 4: matched nothing (0 messages)"


def test_who_is_watched_comes_dearest_first(rules: list[Rule], rows: list[Row]) -> None:
    held = seen(rows, rules)
    table = watched_table(held, held.priced()[0])
    assert [row[:5] for row in table.rows[:4]] == [
        ("to r2", "downlink", "model", 1, "5 kB"),  # 8 * 5000 / 8e3
        ("to server", "uplink", "peers/r1", 1, "1 kB"),  # 8 * 1000 / 200e3
        ("to r2", "sidelink", "peers/r1", 1, "1 kB"),  # 8 * 1000 / 500e3
        ("to r3", "sidelink", "peers/r1", 1, "1 kB"),
    ]
    assert [row[5] for row in table.rows] == ["5 J", "0.04 J", "0.016 J", "0.016 J", "0.008 J", *["0 J"] * 4]
    assert len(table.rows) == len([row for row in rows if row.kind == "publish"])


def test_a_watched_row_fits_the_terminal(rules: list[Rule]) -> None:
    tally = Tally()
    tally.count("", "x" * 30 + "end", ("in", "publish"), 1, 5)
    held = seen(rows_of(tally.counts(), rules), rules)
    ((who, _, topic, *_),) = watched_table(held, held.priced()[0]).rows
    assert (who, topic) == ("from no id", "x" * 10 + "…" + "x" * 8 + "end")


def test_joules_are_told_by_client_phase_label_and_time(left: Path) -> None:
    held = load_metered(left)
    tables = {table.title: [(row[0], row[1]) for row in table.rows] for table in metered_tables(held, held.priced()[0])}
    assert tables["By client"] == [
        ("r2", "5.016 J"), ("server", "0.04 J"), ("r3", "0.016 J"), ("r1", "0.008 J"),
    ]  # fmt: skip
    assert tables["By phase"] == [("ml", "5 J"), ("fl", "0.08 J")]
    assert tables["By time"] == [("01-01 00:16:40", "0.08 J"), ("01-01 00:17:40", "5 J")]
    assert [row[:2] for row in sorted_table(held, held.priced()[0], "+sender").rows] == [["r1", "0.072 J"]]
    with pytest.raises(ConfigurationError, match=r"by 'x': expected one of client, phase, \+arm, \+sender"):
        sorted_table(held, held.priced()[0], "x")


def test_it_is_an_ordinary_run_directory(left: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert report(left, changes=["energy.dl_bit_per_j=4e3"], html=True) == [left / "report-dl4.html"]
    assert "complete, 4 clients" in capsys.readouterr().out
    page = (left / "report-dl4.html").read_text()
    assert "<h2>By client</h2>" in page
    assert ">10 J</td>" in page  # 8 * 5000 / 4e3
    run = Run(left)
    assert (run.status, len(run.rounds)) == ("complete", 0)
    assert run.meter.set_index(["client", "topic"]).at[("r2", "model"), "payload_bytes"] == 5000
    assert run.windows.groupby("begin_s")["payload_bytes"].sum().to_dict() == {1000.0: 4407, 1060.0: 10_000}
    assert run.bill().at["fl", ("ml", "downlink")] == pytest.approx(5)
    assert run.bill(dl_bit_per_j=4e3).at["fl", ("ml", "downlink")] == pytest.approx(10)
    bill = calculate(left).bills
    assert [each["fl"] for each in bill.values()] == [
        each["fl"] for each in calculate(left / BILL, None, ["energy.dl_bit_per_j=8e3"]).bills.values()
    ]
    with pytest.raises(ConfigurationError, match="has no scenario"):
        _ = run.scenario


def test_prometheus_has_bytes_and_joules_by_link_and_direction(left: Path) -> None:
    held = {
        (sample.name, *sample.labels.values()): sample.value
        for metric in MeterCollector(lambda: load_metered(left)).collect()
        for sample in metric.samples
    }
    assert held["jouleswarm_meter_messages_total", "uplink", "in"] == 2
    assert held["jouleswarm_meter_payload_bytes_total", "downlink", "out"] == 5000
    assert held["jouleswarm_meter_packet_bytes_total", "control_packets", "in"] == 14
    assert held["jouleswarm_meter_joules_total", "downlink", "out"] == pytest.approx(5)
    assert held["jouleswarm_meter_joules_total", "downlink", "in"] == 0


def test_what_needs_rounds_is_refused_in_one_line(left: Path) -> None:
    with pytest.raises(ConfigurationError, match="what a meter has counted, which has no rounds"):
        resume_deployment(left, Console())
    with pytest.raises(ConfigurationError, match="no --budget, --why or --meter"):
        report(left, why=True)


def test_what_was_written_is_read_back(left: Path, rows: list[Row], rules: list[Rule]) -> None:
    held = load_metered(left)
    assert (held.rows, held.rules, held.status) == (rows, rules, "complete")
    assert [window.begin_s for window in held.windows] == [1000.0, 1060.0]
    for name in (METER, MANIFEST):
        (left / name).write_text("{")
        with pytest.raises(RunError, match="expected what `jouleswarm meter` writes"):
            load_metered(left)


def test_what_a_killed_meter_leaves_is_readable(left: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (left / SUMMARY).unlink()
    report(left)
    assert "interrupted, 4 clients" in capsys.readouterr().out
    for name in (METER, WINDOWS, BILL):  # before anything was written
        (left / name).unlink()
    report(left)
    assert "nothing passed that a rule prices" in " ".join(capsys.readouterr().out.split())
    assert Run(left).bill().empty


def test_what_is_there_is_not_written_over_and_bad_prices_make_nothing(left: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="one is not empty"):
        Directory(left, tmp_path / "links.toml")
    with pytest.raises(ConfigurationError, match=r"energy\.pue"):
        Directory(tmp_path / "two", tmp_path / "links.toml", None, ["energy.pue=0"])
    assert not (tmp_path / "two").exists()


def test_windows_tell_what_is_new_and_are_merged_two_by_two_beyond_the_most_rows(rules: list[Rule]) -> None:
    tally, windows = Tally(), Windows(100.0, 10.0, most_rows=2)
    for moment in (100, 105, 111, 125):
        tally.count("r1", "up/fl", ("in", "publish"), moment, moment)
        windows.add(float(moment), rows_of(tally.counts(), rules))
        windows.add(float(moment), rows_of(tally.counts(), rules))  # nothing new
    # 100 + 105, 111 and 125 are three windows of 10 s with a row each, of which two become one.
    told = [
        (window.begin_s, window.window_s, sum(row.payload_bytes for row in window.rows)) for window in windows.all()
    ]
    assert told == [(100.0, 20.0, 316), (120.0, 20.0, 125)]


def test_rules_that_are_read_anew_hold_for_all_but_the_windows_before(tmp_path: Path, rules: list[Rule]) -> None:
    tally = Tally()
    tally.count("r1", "up/fl", ("in", "publish"), 100, 110)
    with Directory(tmp_path / "one", tmp_path / "links.toml") as directory:
        recorder = Recorder(directory, tally.counts, 86_400)
        (tmp_path / "links.toml").write_text('"other" = { link = "uplink" }\n"up/+of" = { link = "sidelink" }')
        assert recorder.read_rules()
        tally.count("r1", "up/fl", ("in", "publish"), 7, 17)
        (tmp_path / "links.toml").write_text("none")
        assert not recorder.read_rules()
        asyncio.run(recorder.end())
    held = load_metered(tmp_path / "one")
    assert [(row.link, row.number, row.payload_bytes) for row in held.rows] == [("sidelink", 2, 107)]
    ((_, _, window),) = held.windows
    assert [(row.link, row.number, row.payload_bytes) for row in window] == [("uplink", 1, 100), ("sidelink", 2, 7)]
    metered_tables(held, held.priced()[0])
