"""Installed like any package: built from what the image is built from, run from an empty folder."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from email.parser import Parser
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("agents", "broker", "common", "datacenter")
SHORT = ("federation.max_rounds=2", "federation.target_reward=1000", "meta.t0=1", "learning.batches_per_round=4")


class Done(NamedTuple):
    code: int
    text: str


def run(*command: str | Path, cwd: Path) -> Done:
    own = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        command, cwd=cwd, env={**own, "COLUMNS": "100"}, text=True, timeout=150,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    return Done(done.returncode, done.stdout)


def copied_by_the_dockerfile() -> dict[str, str]:
    """What stands in the checkout -> where it stands in the stage that builds the package."""
    copied = {}
    for line in (ROOT / "Dockerfile").read_text().splitlines():
        if found := re.fullmatch(r"COPY (.+) /source/(.*)", line):
            copied |= {name: found[2] or name for name in found[1].split()}
    return copied


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built by way of the source distribution, which has to have everything too."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("dist")
    for name, place in copied_by_the_dockerfile().items():
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / place, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, source / place)
    done = run(sys.executable, "-m", "build", "--no-isolation", "--outdir", out, source, cwd=out)
    assert done.code == 0, done.text
    assert len(list(out.glob("jouleswarm-*.tar.gz"))) == 1
    (built,) = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of programs of an environment that has the wheel, and sees our dependencies but not the checkout."""
    folder = tmp_path_factory.mktemp("environment")
    assert run(sys.executable, "-m", "venv", "--without-pip", folder, cwd=folder).code == 0
    python = folder / "bin" / "python"
    pip = run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", wheel, cwd=folder)
    assert pip.code == 0, pip.text
    (site,) = folder.glob("lib/python*/site-packages")
    # Lines of a .pth file join the path; .pth files in the folders that they name, as an editable install's, do not.
    dependencies = [path for path in sys.path if path.endswith("site-packages")]
    (site / "dependencies.pth").write_text("".join(f"{path}\n" for path in dependencies))
    return folder / "bin"


@pytest.fixture
def call(installed: Path, tmp_path: Path) -> Callable[..., Done]:
    """Runs a program of the environment from an empty folder."""
    return lambda program, *arguments: run(installed / program, *arguments, cwd=tmp_path)


def test_the_dockerfile_copies_the_house_with_all_its_links_and_none_is_ignored() -> None:
    linked = {link.name for link in (ROOT / "jouleswarm").iterdir() if link.is_symlink()}
    copied = copied_by_the_dockerfile()
    assert linked == set(FOLDERS)
    assert {"jouleswarm", "pyproject.toml", "README.md", "LICENSE", *linked} == set(copied)
    assert all(name == place for name, place in copied.items())
    ignored = {line.strip("/") for line in (ROOT / ".dockerignore").read_text().splitlines()}
    assert ignored.isdisjoint(copied)


def test_a_wheel_has_one_name_at_the_top_and_all_of_the_house_below_it(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    assert {name.split("/")[0] for name in names} == {"jouleswarm", "jouleswarm-0.1.0.dist-info"}
    modules = {path.relative_to(ROOT).as_posix() for path in (ROOT / "jouleswarm").glob("*.py")}
    for room in (path for path in (ROOT / "jouleswarm").iterdir() if path.is_dir()):
        modules |= {f"jouleswarm/{room.name}/{path.relative_to(room)}" for path in room.rglob("*.py")}
    assert {f"jouleswarm/{folder}/__init__.py" for folder in FOLDERS} <= modules
    assert {name for name in names if name.endswith(".py")} == modules
    scenarios = {f"jouleswarm/scenarios/{path.name}" for path in (ROOT / "scenarios").glob("*.toml")}
    assert "jouleswarm/scenarios/quick.toml" in scenarios
    assert {"jouleswarm/py.typed", *scenarios} <= names


def test_a_wheel_says_what_it_is(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        told = Parser().parsestr(archive.read("jouleswarm-0.1.0.dist-info/METADATA").decode())
        kind = Parser().parsestr(archive.read("jouleswarm-0.1.0.dist-info/WHEEL").decode())
        assert b"TERMS AND CONDITIONS" in archive.read("jouleswarm-0.1.0.dist-info/licenses/LICENSE")
    assert (told["Name"], told["License-Expression"], told["Requires-Python"]) == ("jouleswarm", "Apache-2.0", ">=3.11")
    assert (wheel.name, kind["Root-Is-Purelib"]) == ("jouleswarm-0.1.0-py3-none-any.whl", "true")  # of any processor
    assert told.get_payload() == (ROOT / "README.md").read_text()


def test_a_run_from_an_empty_folder_ends_with_its_bill(call: Callable[..., Done], tmp_path: Path) -> None:
    overrides = [part for each in SHORT for part in ("--set", each)]
    done = call("jouleswarm", "run", "toy", "--run-id", "first", "--no-figures", *overrides)
    assert done.code == 0, done.text
    assert "run directory: runs/first" in done.text
    bill = call("jouleswarm", "report", "runs/first")
    assert bill.code == 0, bill.text
    assert "What each arm learned and cost" in bill.text
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_the_robots_world_is_made_by_gymnasium_without_another_import(
    call: Callable[..., Done], installed: Path
) -> None:
    lines = (
        "import gymnasium, sys",
        'world = gymnasium.make("jouleswarm.environments:jouleswarm/Landmarks-v0", task=2)',
        "frame, _ = world.reset(seed=1)",
        "_, reward, *_ = world.step(0)",
        "print(frame.shape, type(reward).__name__, sys.modules['jouleswarm'].__file__)",
    )
    done = call("python", "-c", "\n".join(lines))
    assert done.code == 0, done.text
    assert done.text.startswith("(480, 640, 4) float ")
    assert str(installed.parent) in done.text


@pytest.mark.parametrize("process", ["agents", "broker", "datacenter"])
def test_a_process_is_started_by_its_name_in_the_package(process: str, call: Callable[..., Done]) -> None:
    done = call("python", "-m", f"jouleswarm.{process}", "--help")
    assert (done.code, done.text.splitlines()[0]) == (0, f"Usage: python -m jouleswarm.{process} [OPTIONS]")


@pytest.mark.parametrize("process", ["agents", "broker", "datacenter"])
def test_in_a_checkout_a_process_is_started_by_its_folder(process: str) -> None:
    done = run(sys.executable, "-m", process, "--help", cwd=ROOT)
    assert (done.code, done.text.splitlines()[0]) == (0, f"Usage: python -m {process} [OPTIONS]")


def test_an_unknown_scenario_is_one_line_and_exit_code_2(call: Callable[..., Done], tmp_path: Path) -> None:
    done = call("jouleswarm", "run", "tyo")
    assert done.code == 2
    assert done.text.startswith("jouleswarm run: scenario tyo: no file here, expected one or a name: ")
    assert len(done.text.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
