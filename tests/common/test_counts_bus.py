"""A meter that sends what it counts, where that can't be; where it can, tests/integration/test_proxy.py."""

from __future__ import annotations

import csv
import logging
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from jouleswarm import Meter
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter import counts_bus


def free_port() -> int:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        return int(held.getsockname()[1])


def test_without_a_broker_the_loop_goes_on_is_warned_once_and_the_file_has_what_was_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(counts_bus, "_WAIT_S", 0.3)
    monkeypatch.setattr("jouleswarm.common.meter.loop._FLUSH_S", 0)
    meter = Meter("client-1", file=tmp_path / "counts.csv", broker=f"mqtt://127.0.0.1:{free_port()}")
    with caplog.at_level(logging.WARNING, "jouleswarm.meter"):
        for number in range(3):
            with meter.phase("train", round=number):
                meter.gradients(2)
        meter.flush()
        meter.close()
    with (tmp_path / "counts.csv").open(newline="") as file:
        found = [(row["round"], row["value"]) for row in csv.DictReader(file) if row["what"] == "gradients"]
    assert found == [("0", "2"), ("1", "2"), ("2", "2")]
    told = [record.getMessage() for record in caplog.records]
    assert [("no connection" in line, "could not be sent" in line) for line in told] == [(True, False), (False, True)]


def test_importing_a_meter_loads_no_mqtt_library_and_a_wrong_url_is_one_line(tmp_path: Path) -> None:
    code = "import sys; from jouleswarm import Meter; Meter('c-1'); print({'paho', 'ssl', 'torch'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, text=True, capture_output=True)
    assert done.stdout == "set()\n", done.stderr
    with pytest.raises(ConfigurationError, match="broker URL 'http://a'"):
        Meter("c-1", broker="http://a")
