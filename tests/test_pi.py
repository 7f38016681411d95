"""What a robot on a machine of its own is started with: deploy/systemd."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
UNIT = ROOT / "deploy" / "systemd" / "jouleswarm-robot.service"


def settings(name: str) -> list[str]:
    return re.findall(rf"^{name}=(.*)$", UNIT.read_text(), re.MULTILINE)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze")
def test_systemd_understands_every_line_of_the_unit(tmp_path: Path) -> None:
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/opt/jouleswarm/bin/python", sys.executable))
    done = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_robot_waits_for_its_clock_and_the_network_and_goes_on_after_a_fault() -> None:
    (after,), (restart,) = settings("After"), settings("Restart")
    assert set(after.split()) == {"network-online.target", "time-sync.target"}
    assert (restart, settings("StartLimitIntervalSec")) == ("on-failure", ["0"])
    variables = dict(each.split("=") for line in settings("Environment") for each in line.split())
    assert variables["JOULESWARM_STATE"] == f"/var/lib/{settings('StateDirectory')[0]}"
    assert variables["JOULESWARM_DURABLE"] == "true"  # power may fail
