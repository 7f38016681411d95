"""What the pages say is there: files, modules, commands and options."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import typer.main
import yaml

from jouleswarm.cli.main import app
from tests.test_layout import FLOORS

ROOT = Path(__file__).resolve().parents[1]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]
OF_THE_SITE = {"index.md", "contributing.md", "changelog.md"}  # each is a page of the root, or leads there
MADE = {line.strip("/") for line in (ROOT / ".gitignore").read_text().splitlines()}  # by whoever works in the checkout
NAMES = {path.name for path in ROOT.iterdir()} - MADE

by_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


def missing_links(page: Path) -> list[str]:
    """Links of a page to files that are not there."""
    targets = re.findall(r"\]\(([^)#]+)\)", re.sub(r"```.*?```", "", page.read_text(), flags=re.S))
    return [target for target in targets if "://" not in target and not (page.parent / target).exists()]


def missing_paths(text: str) -> list[str]:
    """Files and folders in backquotes, from the checkout's root, that are not there; capitals stand for others."""
    paths = re.findall(r"`([\w.-]+/(?:[\w.-]+/)*(?:[\w-]+\.\w+)?)`", text)
    known = [path for path in paths if path.split("/")[0] in NAMES and not re.search(r"[A-Z]{3}", path)]
    return [path for path in known if not (ROOT / path).exists()]


def missing_modules(text: str) -> list[str]:
    """Modules of `python -m` that cannot be imported."""
    names = set(re.findall(r"python -m\s+([a-z_.]*[a-z_])\b", text))
    return [name for name in sorted(names) if not is_module(name)]


def is_module(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # of its package
        return False


def wrong_commands(text: str) -> list[str]:
    """Command lines in code that name a command or an option of `jouleswarm` that there is not."""
    wrong = []
    for line in re.findall(
        r"^jouleswarm ((?:.*\\\n)*.*)$", "\n".join(re.findall(r"```sh\n(.*?)```", text, re.S)), re.M
    ):
        words = line.replace("\\\n", " ").split("#")[0].split()
        command: Any = typer.main.get_command(app)
        while hasattr(command, "commands") and words:
            command = command.commands.get(words.pop(0))
        known = {option for each in command.params for option in each.opts} if command else set()
        wrong += [line] if not command or {word for word in words if word.startswith("--")} - known else []
    return wrong


@by_page
def test_a_page_names_only_what_is_there(page: Path) -> None:
    text = page.read_text()
    assert missing_links(page) == []
    assert missing_paths(text) == []
    assert missing_modules(text) == []
    assert wrong_commands(text) == []


def test_what_is_not_there_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("[a](page.md) [b](gone.md) [c](https://example.org/gone.md)")
    assert missing_links(page) == ["gone.md"]
    assert missing_paths("`docs/broker.md` `docs/gone.md` `elsewhere/gone.md`") == ["docs/gone.md"]
    assert {
        "runs",
        "keys",
        "build",
    } <= MADE  # or a run in the checkout, and a page that speaks of one, would be a fault
    assert missing_modules("`python -m jouleswarm.agents`, python -m jouleswarm.gone") == ["jouleswarm.gone"]
    text = "```sh\njouleswarm run toy --set a=1\njouleswarm walk\njouleswarm study paper \\\n  --sneeds 2  # --x\n```"
    assert wrong_commands(text) == ["walk", "study paper \\\n  --sneeds 2  # --x"]


def test_the_readme_is_short_and_leads_to_every_page() -> None:
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 150
    assert {path.name for path in (ROOT / "docs").glob("*.md")} - OF_THE_SITE <= set(
        re.findall(r"docs/([\w-]+\.md)", text)
    )


def test_the_site_is_built_with_every_page_and_no_link_that_leads_nowhere(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-c", "docs/site", "docs", tmp_path]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240)
    assert (done.returncode, done.stderr) == (0, "")
    first = (tmp_path / "index.html").read_text()
    assert "What does this learning scheme cost in joules and bits, really?" in first
    fetched = re.findall(r"<(?:script|link|img)[^>]*(?:src|href)=\"(https?://[^\"]*)", first)
    assert fetched == []  # a page works on a machine without a network


def test_the_citation_is_of_this_version_and_of_the_paper() -> None:
    told = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert (told["version"], told["license"]) == (project["version"], project["license"])
    assert [each["family-names"] for each in told["references"][0]["authors"]] == [
        "Savazzi",
        "Rampa",
        "Kianoush",
        "Bennis",
    ]
    assert f"## {project['version']} " in (ROOT / "CHANGELOG.md").read_text()


def undefined_steps(text: str) -> list[str]:
    """Functions that a numbered step names after a link to their file, and the file does not define."""
    undefined = []
    for step in re.findall(r"^\d+\. (.*)$", text, re.M):
        for target, names in re.findall(r"\]\(\.\./([\w./]+\.py)\)((?:,? `\w+`)+)", step):
            source = (ROOT / target).read_text()
            for name in re.findall(r"\w+", names):
                undefined += [] if re.search(rf"\b(?:def|class) {name}\b", source) else [f"{target} {name}"]
    return undefined


def test_each_step_of_the_three_ways_is_in_the_code_and_no_way_is_long() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text()
    ways = text.split("\n### ")[1:]
    assert [way.splitlines()[0] for way in ways] == [
        "An observation",
        "A robot's weights",
        "A counted byte, to a joule",
    ]
    assert [undefined_steps(way) for way in ways] == [[], [], []]
    assert all(8 <= len(re.findall(r"^\d+\. ", way, re.M)) <= 12 for way in ways)


def test_a_step_that_is_not_in_the_code_is_found() -> None:
    told = "1. [dqn.py](../jouleswarm/learning/dqn.py) `td_loss`, `td_lost`: a step"
    assert undefined_steps(told) == ["jouleswarm/learning/dqn.py td_lost"]


def test_the_drawing_of_rooms_has_each_room_on_its_floor() -> None:
    drawing = (ROOT / "docs" / "architecture.md").read_text().split("```")[1]
    floors = {int(line.split()[0]): line for line in drawing.splitlines() if re.match(r" \d  ", line)}
    for floor, rooms in enumerate(FLOORS[:-1]):
        assert all(re.search(rf"\b{room}\b", floors[floor]) for room in rooms), floor
