"""What a meter leaves, and what it costs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.tally import Row, Tally, rows_of
from jouleswarm.common.scenario.tariff import read_tariff
from jouleswarm.common.wire.rules import Rule, read_rules
from jouleswarm.metering.written import BILL, METER, read_metered, unmatched, write_rows
from jouleswarm.report.calculated import calculate
from jouleswarm.report.metered import metered_table, watched_table

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


def test_bytes_are_priced_by_the_link_of_their_rule(tmp_path: Path, rules: list[Rule], rows: list[Row]) -> None:
    write_rows(tmp_path, rows, rules)
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


def test_every_row_is_a_line_with_its_rule_and_labels(tmp_path: Path, rules: list[Rule], rows: list[Row]) -> None:
    write_rows(tmp_path, rows, rules)
    found = {(row["client"], row["topic"]): row for row in map(json.loads, (tmp_path / METER).read_text().splitlines())}
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
    table = metered_table(rows, ["never"])
    assert table.rows[0] == ["uplink: up/+arm", 2, "200 B", 1, "200 B", "440 B", 1]
    assert table.rows[-1][0] == "other: no rule"
    assert table.notes[0] == "never: matched nothing (0 messages)"


def test_who_is_watched_comes_dearest_first(rows: list[Row], rules: list[Rule]) -> None:
    tariff = read_tariff(None, ["energy.dl_bit_per_j=8e3"], {1, 2, 3})
    table = watched_table(rows, rules, tariff)
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
    ((who, _, topic, *_),) = watched_table(rows_of(tally.counts(), rules), rules, read_tariff(None, (), ())).rows
    assert (who, topic) == ("from no id", "x" * 10 + "…" + "x" * 8 + "end")


def test_what_was_written_is_read_back(tmp_path: Path, rows: list[Row], rules: list[Rule]) -> None:
    write_rows(tmp_path, rows, rules)
    assert read_metered(tmp_path) == (rows, rules)
    (tmp_path / METER).write_text("{")
    with pytest.raises(RunError, match="expected what `jouleswarm meter` writes"):
        read_metered(tmp_path)
