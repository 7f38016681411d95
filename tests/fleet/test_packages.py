"""Our name means our package, whatever stands in the current folder, on PYTHONPATH or beside it."""

import os
import subprocess
from pathlib import Path

import pytest

from jouleswarm.fleet.packages import NAME, command_of

STANDARD = ("json", "random", "types", "logging", "sitecustomize", "numpy", "torch")
FOLDERS = ("agents", "broker", "common", "datacenter")


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


@pytest.mark.parametrize("module", ["jouleswarm.broker", "jouleswarm.agents"])
def test_nothing_of_the_current_folder_is_executed(module: str, tmp_path: Path) -> None:
    folder = traps(tmp_path / "hostile", NAME, *FOLDERS, *STANDARD)
    code, text = run(module, folder)
    assert (code, f"Usage: python -m {module}" in text) == (0, True), text
    assert list(folder.glob("executed-*")) == []


def test_our_package_comes_before_one_that_PYTHONPATH_names(tmp_path: Path) -> None:
    folder = traps(tmp_path / "hostile", NAME, *FOLDERS)
    code, _ = run("jouleswarm.agents", tmp_path, PYTHONPATH=str(folder))
    assert code == 0
    assert list(folder.glob("executed-*")) == []
