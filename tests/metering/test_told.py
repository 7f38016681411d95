"""What clients tell of themselves: added up, bounded, and beside the bytes in one bill."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.errors import PayloadError
from jouleswarm.common.meter.tally import Tally, rows_of
from jouleswarm.metering.directory import Directory
from jouleswarm.metering.metered import load_metered
from jouleswarm.metering.told import Heard
from jouleswarm.report.calculated import calculate


def row(what: str, value: float, robot: str = "client-3", **more: Any) -> list[Any]:
    """As a meter has it."""
    cells = {"phase": "fl", "robot": robot, "what": what, "value": value} | more
    columns = ("arm", "phase", "task", "robot", "to", "what", "value", "end", "activity", "round", "how")
    return [cells.get(column, "") for column in columns]


def message(number: int, *rows: list[Any], sender: str = "a") -> bytes:
    return json.dumps({"from": sender, "number": number, "rows": rows}).encode()


def test_a_message_that_comes_twice_counts_once() -> None:
    heard = Heard()
    for payload in (
        message(1, row("gradients", 20)),
        message(1, row("gradients", 20)),
        message(2, row("gradients", 5)),
    ):
        heard.take(payload)
    heard.take(message(1, row("gradients", 1), sender="another"))
    assert [(each["robot"], each["what"], each["value"]) for each in heard.rows()] == [("client-3", "gradients", 26)]


@pytest.mark.parametrize(
    "payload",
    [
        b"", b"[]", b"\xff", b'{"from": "a", "number": 1}', message(0), message(1, ["too", "few"]),
        message(1, row("dreams", 1)), message(1, row("gradients", -1)), message(1, row("gradients", float("inf"))),
        message(1, row("gradients", 1), row("gradients", 1, robot="a\nb")),
        message(1, row("gradients", 1, robot="x" * 101)),
    ],
)  # fmt: skip
def test_what_is_no_message_is_refused_whole_and_told_once(payload: bytes, caplog: pytest.LogCaptureFixture) -> None:
    heard = Heard()
    with pytest.raises(PayloadError, match=r"expected what `jouleswarm\.Meter` sends"):
        heard.take(payload)
    heard.hear(payload)
    heard.hear(payload)
    assert (heard.rows(), heard.refused, len(caplog.records)) == ([], 2, 1)


def test_beyond_the_most_rows_rounds_are_not_told_apart() -> None:
    heard = Heard(most_rows=2)
    heard.take(message(1, *(row("gradients", 1, round=str(number)) for number in range(5))))
    assert [(each["round"], each["value"]) for each in heard.rows()] == [("", 3), ("0", 1), ("1", 1)]


def test_compute_stands_beside_bytes_in_one_bill_and_bytes_count_once(tmp_path: Path) -> None:
    (tmp_path / "links.toml").write_text('"up" = { link = "uplink" }')
    directory, tally, heard = Directory(tmp_path / "one", tmp_path / "links.toml"), Tally(), Heard()
    tally.count("client-3", "up", ("in", "publish"), 1000, 1010)
    heard.take(
        message(
            1,
            *(row("gradients", 20, activity="train", round=str(number)) for number in (1, 2)),
            row("uplink_bytes", 1000, end="sent"),
            row("seconds", 2.5, activity="train"),
            row("joules", 7, activity="train", how="rapl"),
            row("gradients", 3, robot="datacenter"),
        )
    )
    directory.write(rows_of(tally.counts(), directory.rules), told=heard.rows())
    held = load_metered(tmp_path / "one")
    assert (held.numbers, list(held.facts)) == ({"client-3": 3}, ["experiment"])
    counts = held.facts["experiment"].counts.fl
    assert (counts.uplink_bytes, counts.gradients_robots, counts.gradients_support) == (1000, 40, 3)
    found = calculate(tmp_path / "one")
    assert [(each.activity, each.seconds, each.joules) for each in found.measured] == [("train", 2.5, {"rapl": 7})]
    ((bills, *_),) = [list(each.values()) for each in found.bills.values()][:1]
    # Table I: 5.1 W for 0.4 s a gradient of a robot; 200 kb/J up.
    assert bills is not None
    assert bills.fl.computing_robots_j == pytest.approx(40 * 5.1 * 0.4)
    assert bills.fl.uplink_j == pytest.approx(8 * 1000 / 200e3)
    assert calculate(tmp_path / "one" / "bill.csv").facts == found.facts
