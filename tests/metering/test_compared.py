"""What meters have counted, side by side and handed over."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from typer.testing import CliRunner

from jouleswarm.cli.main import app
from jouleswarm.common.meter.tally import Tally, rows_of
from jouleswarm.common.wire.rules import read_rules
from jouleswarm.metering.directory import Directory
from jouleswarm.metering.windows import Windows


def leave(folder: Path, links: str, model_bytes: int, efficiency: float) -> Path:
    """A meter's directory: two messages up, one down."""
    rules = folder.parent / f"{folder.name}.toml"
    rules.write_text(links)
    tally = Tally()
    for _ in range(2):
        tally.count("r1", "up", ("in", "publish"), 1000, 1004)
    tally.count("r1", "model", ("out", "publish"), model_bytes, model_bytes + 10)
    windows, rows = Windows(1000.0, 60.0), rows_of(tally.counts(), read_rules(rules))
    windows.add(1001.0, rows)
    with Directory(folder, rules, None, [f"energy.ul_bit_per_j={efficiency}"]) as directory:
        directory.write(rows, windows.all())
        directory.end()
    return folder


@pytest.fixture
def both(tmp_path: Path) -> list[str]:
    links = '"up" = { link = "uplink" }\n"model" = { link = "downlink" }\n'
    first = leave(tmp_path / "json", links, 4000, 200e3)
    second = leave(tmp_path / "int8", links.replace('"downlink"', '"control"'), 1000, 400e3)
    return [str(first), str(second)]


def jouleswarm(*words: str) -> Any:
    return CliRunner().invoke(app, [*words])


def test_two_meters_are_compared_by_link_with_what_differs_in_rules_and_prices(both: list[str]) -> None:
    done = jouleswarm("compare", *both, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.output)
    first, second = (each["links"] for each in found["runs"])
    # up: 8 * 2000 bits by 200 and 400 kb/J; down: 8 * 4000 by Table I's 200 kb/J, then as control for nothing
    assert first["uplink"] == {"sent": 2, "got": 0, "packet_bytes": 2008, "joules": pytest.approx(0.08)}
    assert second["uplink"]["joules"] == pytest.approx(0.04)
    assert first["downlink"] == {"sent": 0, "got": 1, "packet_bytes": 4010, "joules": pytest.approx(0.16)}
    assert second["control"] == {"sent": 0, "got": 1, "packet_bytes": 1010, "joules": 0}
    assert (first["all links"]["joules"], second["all links"]["joules"]) == (pytest.approx(0.24), pytest.approx(0.04))
    assert found["differences"] == {
        "energy.ul_bit_per_j": [None, 400e3],  # 200 kb/J is what Table I has
        "rule model": ["downlink, fl", "control, fl"],
    }
    shown = jouleswarm("compare", *both).output
    assert "uplink: joules" in shown
    assert "0.5" in shown  # the second over the first
    assert "rule model: A downlink, fl, B control, fl" in shown


def test_a_meters_counts_are_exported_as_tables_and_reported_as_plain_data(both: list[str], tmp_path: Path) -> None:
    done = jouleswarm("export", both[0], "--to", "csv", "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, done.output
    meter = pd.read_csv(tmp_path / "out" / "json" / "meter.csv")
    assert meter[["client", "topic", "link", "messages", "payload_bytes"]].to_numpy().tolist() == [
        ["r1", "model", "downlink", 1, 4000],
        ["r1", "up", "uplink", 2, 2000],
    ]
    found = json.loads(jouleswarm("report", both[0], "--json").output)
    assert found["bill"]["arms"]["experiment"]["counts"]["fl"]["uplink_bytes"] == 2000
    assert found["tables"][0]["rows"][0]["link: rule"] == "uplink: up"
