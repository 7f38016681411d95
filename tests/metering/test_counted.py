"""The run directory of a Flower run, as a meter's: counts by hand."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from rich.console import Console

from jouleswarm import Run
from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.counts_file import COUNTS, CountsFile
from jouleswarm.metering.metered import load_metered
from jouleswarm.report.metered_report import report_metered

RULES = '"+arm/+round/+activity/up" = { link = "uplink" }\n"+arm/+round/+activity/down" = { link = "downlink" }\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two clients; client-1 is sent a model twice and sends one, client-2 stays away."""
    manifest = {"kind": "meter", "schema": 1, "of": "Flower", "run": "flower-1", "rules": RULES, "energy": {}}
    (tmp_path / "manifest.json").write_text(json.dumps(manifest | {"robots": [], "versions": {}, "started": "today"}))
    counted = [
        ("client-1", "downlink_bytes", 1000, "sent", "train", 1, ""),
        ("client-1", "downlink_messages", 1, "sent", "train", 1, ""),
        ("client-1", "downlink_array_bytes", 800, "sent", "train", 1, ""),
        ("client-2", "downlink_bytes", 1001, "sent", "train", 1, ""),
        ("client-2", "downlink_messages", 1, "sent", "train", 1, ""),
        ("client-2", "downlink_array_bytes", 800, "sent", "train", 1, ""),
        ("client-1", "uplink_bytes", 500, "received", "train", 1, ""),
        ("client-1", "uplink_messages", 1, "received", "train", 1, ""),
        ("client-1", "uplink_array_bytes", 400, "received", "train", 1, ""),
        ("client-1", "gradients", 20.0, "", "train", 1, ""),
        ("client-1", "seconds", 1.5, "", "train", 1, ""),
        ("client-1", "joules", 30.0, "", "train", 1, "rapl"),
        ("client-1", "downlink_bytes", 1000, "sent", "train", 2, ""),
        ("client-1", "downlink_messages", 1, "sent", "train", 2, ""),
    ]
    CountsFile(tmp_path / COUNTS, "here").put([("FedAvg", "fl", "", name, "", *cells) for name, *cells in counted])
    return tmp_path


def test_bytes_are_rows_by_client_and_round_and_are_priced(folder: Path) -> None:
    run = Run(folder)
    rows = [
        (row.client, row.topic, row.direction, row.messages, row.payload_bytes) for row in load_metered(folder).rows
    ]
    assert rows == [
        ("client-1", "FedAvg/1/train/down", "out", 1, 1000),
        ("client-2", "FedAvg/1/train/down", "out", 1, 1001),
        ("client-1", "FedAvg/2/train/down", "out", 1, 1000),
        ("client-1", "FedAvg/1/train/up", "in", 1, 500),
    ]
    joules = run.bill()["fl"].loc["FedAvg"]
    assert joules["uplink"] == pytest.approx(500 * 8 / 200e3)
    assert joules["downlink"] == pytest.approx(3001 * 8 / 200e3)
    assert joules["computing_robots"] == pytest.approx(20 * 5.1 * 0.4)


def test_a_report_tells_arrays_and_what_was_measured_beside_the_bill(folder: Path) -> None:
    shown = io.StringIO()
    report_metered(load_metered(folder), console=Console(file=shown, width=120))
    assert "flower-1: metered since today, interrupted, 2 clients" in shown.getvalue()
    assert "all bytes of Flower messages: to the server 500, from it 3001" in shown.getvalue()
    assert "of them in arrays: to the server 400, from it 1600" in shown.getvalue()
    assert "joules, rapl" in " ".join(shown.getvalue().split())


def test_a_spoilt_file_is_refused_in_one_line(folder: Path) -> None:
    with (folder / COUNTS).open("a") as file:
        file.write("FedAvg,fl,,client-1,,uplink_bytes,many,received,train,2,\n")
    with pytest.raises(RunError, match=r"counts\.csv: cannot be read"):
        load_metered(folder)
