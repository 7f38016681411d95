"""The broker as a meter of any application, by rules."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from jouleswarm.broker.by_rule import RuleKey, RuleMeter
from jouleswarm.broker.meter import BrokerMeter, by_link
from jouleswarm.common.bus.paho_client import wire_id
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.counters import read_counters
from jouleswarm.common.meter.tally import RULED, Row, Tally, rows_of
from jouleswarm.common.wire.links import OWN
from jouleswarm.common.wire.rules import read_rules

ROOT = Path(__file__).parents[2]
LINKS = """\
"fed/+round/+client/up" = { link = "uplink" }
"peers/+sender/#rest" = [{ link = "uplink", receiver = "server*" }, { link = "sidelink", phase = "ml" }]
"never" = { link = "control" }
"""


@pytest.fixture
def links(tmp_path: Path) -> Path:
    (tmp_path / "links.toml").write_text(LINKS)
    return tmp_path / "links.toml"


def told(rows: list[Row]) -> dict[tuple[str, str, str, str], tuple[str, int, int, int]]:
    """(direction, kind, client, topic) -> link, messages, payload bytes, packet bytes."""
    return {
        (row.direction, row.kind, row.client, row.topic): (
            row.link,
            row.messages,
            row.payload_bytes,
            row.packet_bytes,
        )
        for row in rows
    }


def test_the_first_rule_that_matches_has_the_bytes_and_the_receiver_tells_links_apart(links: Path) -> None:
    meter = BrokerMeter(by_rule=RuleMeter(links))
    for _ in range(2):
        meter.count("robot-1", "peers/robot-1/w", "in", 100, 120)
    meter.count("server-1", "peers/robot-1/w", "out", 100, 120)
    meter.count("robot-2", "peers/robot-1/w", "out", 100, 120)
    meter.repeated("robot-2", "peers/robot-1/w", "out", 100, 120)
    meter.count("robot-2", "peers/robot-1/w", "acked", 100, 120)
    meter.count("robot-1", "who/knows", "in", 7, 20)
    meter.control("robot-1", "in", 14)
    assert meter.by_rule is not None
    assert told(meter.by_rule.rows()) == {
        ("in", "publish", "robot-1", "peers/robot-1/w"): ("sidelink", 2, 200, 240),
        ("out", "publish", "server-1", "peers/robot-1/w"): ("uplink", 1, 100, 120),
        ("out", "publish", "robot-2", "peers/robot-1/w"): ("sidelink", 1, 100, 120),
        ("in", "publish", "robot-1", "who/knows"): ("other", 1, 7, 20),
        ("in", "control", "robot-1", ""): ("", 1, 0, 14),
    }
    assert [row.repeats for row in meter.by_rule.rows() if row.client == "robot-2"] == [1]
    totals = {key: counts for key, counts in meter.by_rule.totals().items() if any(counts)}
    assert totals == {
        RuleKey("publish", "in", "sidelink", "ml", "peers/+sender/#rest"): (2, 200, 240),
        RuleKey("publish", "out", "sidelink", "ml", "peers/+sender/#rest"): (1, 100, 120),
        RuleKey("publish", "out", "uplink", "fl", "peers/+sender/#rest", "", "server*"): (1, 100, 120),
        RuleKey("publish", "in", "other"): (1, 7, 20),
        RuleKey("control", "in"): (1, 0, 14),
    }
    assert meter.by_rule.told()[2:] == [
        f"{links}, line 2, peers/+sender/#rest (sidelink): 2 messages of 200 bytes received, "
        "1 messages of 100 bytes delivered",
        f"{links}, line 3, never (control): matched nothing (0 messages)",
        "other, which no rule matches: 1 messages of 7 bytes received, 0 messages of 0 bytes delivered",
    ]
    assert meter.rows() == []  # no run's


def test_by_the_products_own_rules_sums_are_those_of_runs() -> None:
    meter = BrokerMeter(by_rule=RuleMeter(OWN))
    for way in ("in", "out"):
        for topic in ("ul/1/1/experience", "ul/1/1/weights", "dl/meta", "sl/1/1/weights", "ctl/1/1/resend", "tlm/1/x"):
            meter.count(wire_id("agent-1"), f"jouleswarm/run/maml/{topic}", way, 10, 50)
    assert meter.by_rule is not None
    sums: dict[str, dict[str, int]] = {}
    for row in meter.by_rule.rows():
        sums.setdefault(row.link, {"in": 0, "out": 0})[row.direction] += row.packet_bytes
    own = by_link(meter.totals().items())
    assert {link.value: {way: held["packet_bytes"] for way, held in ways.items()} for link, ways in own.items()} == sums
    assert sums["uplink"] == {"in": 100, "out": 100}


def test_a_client_is_its_user_where_there_are_users_and_nobody_where_it_has_no_id(links: Path) -> None:
    meter, by_user = BrokerMeter(by_rule=RuleMeter(links)), BrokerMeter(by_rule=RuleMeter(links, by_user=True))
    for client in ("agent-3.1f00aa22", "amqtt/made-up-by-the-broker"):
        meter.count(client, "never", "in", 1, 8)
    by_user.count("agent-3.1f00aa22", "never", "in", 1, 8)
    assert meter.by_rule is not None
    assert by_user.by_rule is not None
    assert {row.client for row in meter.by_rule.rows()} == {"agent-3.1f00aa22", ""}
    assert {row.client for row in by_user.by_rule.rows()} == {"agent-3"}


def test_who_makes_topics_up_fills_no_memory_and_is_counted_all_the_same(
    links: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("jouleswarm.broker.by_rule.Tally", partial(Tally, 3))
    meter = BrokerMeter(by_rule=RuleMeter(links))
    for number in range(1000):
        meter.count("x", f"made/up/{number}", "in", 1, 12)
    meter.repeated("x", "made/up/999", "in", 1, 12)  # of which there is no row
    assert meter.by_rule is not None
    rows = meter.by_rule.rows()
    assert told(rows)["in", "overflow", "", ""] == ("", 997, 997, 997 * 12)
    assert (len(rows), len(meter._counters)) == (4, 3)
    assert meter.by_rule.totals()[RuleKey("overflow", "in")] == (997, 997, 997 * 12)
    assert meter.by_rule.told()[-1].startswith("beyond the most rows: 997 messages of 997 bytes received")


def test_rules_read_anew_are_of_what_was_counted_before_too_and_bad_ones_change_nothing(links: Path) -> None:
    meter = BrokerMeter(by_rule=RuleMeter(links))
    assert meter.by_rule is not None
    meter.count("c", "who/knows", "in", 7, 20)
    meter.count("c", "fed/1/c/up", "in", 7, 20)
    links.write_text(LINKS + '"a/b+" = { link = "uplink" }')
    with pytest.raises(ConfigurationError, match="line 4: 'a/b"):
        meter.read_rules()
    meter.count("c", "who/knows", "in", 7, 20)
    assert told(meter.by_rule.rows())["in", "publish", "c", "who/knows"] == ("other", 2, 14, 40)
    links.write_text('"who/+" = { link = "downlink" }\n' + LINKS)
    assert meter.read_rules() == 5
    meter.count("c", "who/knows", "in", 7, 20)
    meter.count("c", "fed/1/c/up", "in", 7, 20)
    assert told(meter.by_rule.rows())["in", "publish", "c", "who/knows"] == ("downlink", 3, 21, 60)
    # What Prometheus is shown only ever grows.
    assert meter.by_rule.totals()[RuleKey("publish", "in", "downlink", "fl", "who/+")] == (1, 7, 20)
    assert meter.by_rule.totals()[RuleKey("publish", "in", "uplink", "fl", "fed/+round/+client/up")] == (2, 14, 40)


def test_a_broker_that_was_killed_goes_on(links: Path, tmp_path: Path) -> None:
    BrokerMeter(by_rule=RuleMeter(links, tmp_path / "state")).count("c", "fed/1/c/up", "in", 7, 20)
    again = RuleMeter(links, tmp_path / "state")
    BrokerMeter(by_rule=again).count("c", "fed/1/c/up", "in", 7, 20)
    assert told(again.rows()) == {("in", "publish", "c", "fed/1/c/up"): ("uplink", 2, 14, 40)}
    assert again.totals()[RuleKey("publish", "in", "uplink", "fl", "fed/+round/+client/up")] == (2, 14, 40)


def test_odd_clients_and_topics_have_rows_and_wildcards_have_none(
    start_broker, raw, eventually, links: Path, tmp_path: Path
) -> None:
    broker = start_broker("--links", str(links), "--state", str(tmp_path / "state"))
    odd = raw(broker)
    odd.connect("a/#+ ü\\\u2028")
    odd.publish("fed/1//up", b"12345", qos=1)
    odd.send(0x38 | 2, b"\0\x09fed/1//up\0\x07" + b"12345")  # again, with DUP
    assert odd.read() == (0x40, b"\0\x07")
    wild = raw(broker)
    wild.connect("wild")
    wild.send(0x30, b"\0\x05fed/#12345")
    assert wild.is_closed_by_broker()
    samples = broker.scrape()
    labels = 'direction="in",kind="publish",link="uplink",phase="fl",receiver="",rule="fed/+round/+client/up",sender=""'
    # 2 for the head, 2 + 9 for the topic, 2 for the identifier, 5
    assert samples[f"jouleswarm_broker_rule_packet_bytes_total{{{labels}}}"] == 40
    found = rows_of(read_counters(tmp_path / "state" / RULED), read_rules(links))
    assert told(found) == {
        ("in", "publish", "a/#+ ü\\\u2028", "fed/1//up"): ("uplink", 2, 10, 40),
        ("in", "control", "a/#+ ü\\\u2028", ""): ("", 1, 0, 2 + 10 + 2 + len("a/#+ ü\\\u2028".encode())),
        ("out", "control", "a/#+ ü\\\u2028", ""): ("", 3, 0, 3 * 4),
        ("in", "control", "wild", ""): ("", 1, 0, 2 + 10 + 2 + 4),
        ("out", "control", "wild", ""): ("", 1, 0, 4),
    }
    assert [row.repeats for row in found if row.kind == "publish"] == [1]


def test_sighup_reads_rules_anew_and_a_bad_file_is_a_line_in_the_log(links: Path) -> None:
    command = [sys.executable, "-m", "jouleswarm.broker", "--port", "0", "--no-metrics", "--links", str(links)]
    process = subprocess.Popen(
        command, cwd=ROOT, text=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stderr is not None
    assert process.stdout.readline().startswith("Broker at mqtt://")
    links.write_text('"+x/+x" = { link = "uplink" }')
    process.send_signal(signal.SIGHUP)
    assert "line 1: '+x/+x' names two levels x, expected each name once; the rules before" in process.stderr.readline()
    links.write_text('\n"new" = { link = "uplink" }')
    process.send_signal(signal.SIGHUP)
    assert process.stderr.readline().endswith(f"1 rules of {links} from now on\n")
    process.terminate()
    out, _ = process.communicate(timeout=20)
    assert (process.returncode, out) == (0, f"{links}, line 2, new (uplink): matched nothing (0 messages)\n")


def test_rules_that_can_not_be_are_one_line_with_the_files_line_number_and_exit_code_2(links: Path) -> None:
    for text, options, expected in (
        (LINKS + '"x" = { link = "uplnk" }', (), f"broker: {links}, line 4: 'x': link: Input should be 'uplink'"),
        (LINKS, ("--no-meter",), "broker: got --links and --no-meter; expected one of them"),
    ):
        links.write_text(text)
        command = [sys.executable, "-m", "jouleswarm.broker", "--port", "0", "--no-metrics", "--links", str(links)]
        ended = subprocess.run([*command, *options], cwd=ROOT, capture_output=True, text=True, timeout=30)
        (line,) = ended.stderr.splitlines()
        assert (ended.returncode, line.startswith(expected)) == (2, True), json.dumps(line)
