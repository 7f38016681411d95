"""Names of ours mean our packages, whatever stands in the current folder, on PYTHONPATH or beside them."""

import os
import subprocess
from pathlib import Path

import pytest

from jouleswarm.fleet.packages import NAMES, ROOT, command_of, rivals

STANDARD = ("json", "random", "types", "logging", "sitecustomize", "numpy", "torch")


def traps(folder: Path, *names: str) -> Path:
    """Modules that leave a mark beside them when they are executed."""
    folder.mkdir()
    for name in names:
        mark = folder / f"executed-{name}"
        (folder / f"{name}.py").write_text(f"import pathlib\npathlib.Path({str(mark)!r}).touch()\n")
    return folder


def run(module: str, cwd: Path, **environment: str) -> tuple[int, str]:
    command = [*command_of(module), "--help"]
    done = subprocess.run(command, cwd=cwd, env=os.environ | environment, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize("module", ["broker", "agents"])
def test_nothing_of_the_current_folder_is_executed(module: str, tmp_path: Path) -> None:
    folder = traps(tmp_path / "hostile", *NAMES, *STANDARD)
    code, text = run(module, folder)
    assert (code, f"Usage: python -m {module}" in text) == (0, True), text
    assert list(folder.glob("executed-*")) == []


def test_our_packages_come_before_those_that_PYTHONPATH_names(tmp_path: Path) -> None:
    folder = traps(tmp_path / "hostile", *NAMES)
    code, _ = run("agents", tmp_path, PYTHONPATH=str(folder))
    assert code == 0
    assert list(folder.glob("executed-*")) == []


def installed(site: Path, name: str, record: str) -> None:
    folder = site / f"{name}-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (folder / "RECORD").write_text(record)


def test_a_distribution_with_files_under_a_name_of_ours_is_found(tmp_path: Path) -> None:
    installed(tmp_path, "jouleswarm", "agents/__init__.py,,\nbroker/core.py,,\n")
    installed(tmp_path, "another", "another/agents/__init__.py,,\nagentsmith/__init__.py,,\ncommons.py,,\n")
    assert rivals(tmp_path) == {}
    installed(tmp_path, "other-agents", "other/__init__.py,,\nagents/__init__.py,,\nagents/run.py,,\n")
    installed(tmp_path, "bare", "common.py,,\n")
    assert rivals(tmp_path) == {"agents": "other-agents", "common": "bare"}


def test_here_nobody_has() -> None:
    assert rivals(ROOT) == {}
