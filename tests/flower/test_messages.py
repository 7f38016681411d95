"""Flower's messages as the meter sees them: `inside.py` runs in Flower's own environment, expectations are here."""

from __future__ import annotations

import csv
import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
PYTHON = HERE.parents[1] / ".venv-flower" / "bin" / "python"
MEASURED = ("seconds", "cpu_s", "joules")

pytestmark = [
    pytest.mark.flower,
    pytest.mark.skipif(not PYTHON.exists(), reason="no Flower: `make flower`"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="module")
def found(folder: Path) -> dict[str, Any]:
    environment = {**os.environ, "FLWR_TELEMETRY_ENABLED": "0", "PYTHONPATH": str(HERE.parents[1])}
    done = subprocess.run(
        [PYTHON, HERE / "inside.py", folder], env=environment, cwd=folder, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return {**json.loads(done.stdout.splitlines()[-1]), "log": done.stderr}


def rows(folder: Path, run: int) -> dict[tuple[str, str], dict[str, str]]:
    """By who and what."""
    with (folder / f"flower-{run}" / "counts.csv").open(newline="") as file:
        return {(row["robot"], row["what"]): row for row in csv.DictReader(file)}


def test_a_message_has_as_many_bytes_as_flower_serialises(found: dict[str, Any]) -> None:
    assert [size for size, _, _ in found["sizes"]] == [serialised for _, _, serialised in found["sizes"]]
    assert len(found["sizes"]) == 2 + 410 + 69 + 3
    arrays = [arrays for _, arrays, _ in found["sizes"]]
    assert arrays[:2] == [0, 1]
    # None; [3, 4], a scalar and [2, 0] in float32; [2, 3] in float64.
    assert arrays[-3:] == [0, (12 + 1 + 0) * 4, 6 * 8]


def test_every_message_is_in_the_row_of_its_client(found: dict[str, Any], folder: Path) -> None:
    counted = rows(folder, 42)
    names = {11: "client-0", 22: "node-22", 33: "node-33", 44: "node-44", 55: "node-55"}
    assert {robot for robot, _ in counted} == set(names.values())
    for node, name in names.items():
        assert int(counted[name, "downlink_bytes"]["value"]) == found["serialised"][f"downlink {node}"]
        assert counted[name, "downlink_array_bytes"]["value"] == "40"  # float32 [5, 2]
        assert (name, "uplink_array_bytes") not in counted
        if node == 55:  # has not replied
            assert (name, "uplink_bytes") not in counted
        else:
            assert int(counted[name, "uplink_bytes"]["value"]) == found["serialised"][f"uplink {node}"]
    assert {(row["arm"], row["activity"], row["round"]) for row in counted.values()} == {("mine", "train", "2")}


def test_what_a_client_took_comes_with_its_reply_and_the_strategy_does_not_see_it(
    found: dict[str, Any], folder: Path
) -> None:
    counted = rows(folder, 42)
    for name in ("client-0", "node-22"):
        assert float(counted[name, "gradients"]["value"]) == 3 + 1
        assert {what for robot, what in counted if robot == name} >= set(MEASURED)
        assert counted[name, "joules"]["how"]
    assert (found["replies"], found["records_left"]) == (4, 0)


def test_a_record_that_is_not_ours_is_refused_and_its_message_counted(found: dict[str, Any], folder: Path) -> None:
    assert {what for robot, what in rows(folder, 42) if robot == "node-44"}.isdisjoint({*MEASURED, "gradients"})
    assert "node 44: record 'jouleswarm': ValueError(\"partition-id '../x'\")" in found["log"]


def test_an_app_that_pushes_and_pulls_is_metered_too(found: dict[str, Any], folder: Path) -> None:
    counted = rows(folder, 43)
    assert {robot for robot, _ in counted} == {"client-0"}
    assert {"downlink_bytes", "uplink_bytes", "gradients"} <= {what for _, what in counted}


def test_a_file_that_cannot_be_written_ends_no_run(found: dict[str, Any], folder: Path) -> None:
    assert found["replies_when_full"] == 1
    assert "counts.csv cannot be written (Is a directory), tried again later" in found["log"]
    assert ("client-0", "uplink_bytes") in rows(folder, 44)


def test_what_cannot_be_metered_is_refused_in_one_line(found: dict[str, Any]) -> None:
    assert found["fraction"] == 0.5  # the strategy's own
    nested, number, folder, fewer = found["refused"]
    assert nested.endswith("metered: configure_train is called from outside, expected metered(...) outermost")
    assert number.endswith("metered: got int, expected a strategy or a grid")
    assert folder.endswith("run directory /proc/none/flower-46: No such file or directory (/proc/none)")
    assert fewer.endswith("gradients: -1, expected 0 or more")


def test_a_client_needs_nothing_of_ours_but_the_standard_library(found: dict[str, Any]) -> None:
    assert {"torch", "pandas", "scipy", "gymnasium", "amqtt", "paho"}.isdisjoint(found["loaded"])
