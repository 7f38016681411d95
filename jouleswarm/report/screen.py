"""The answer on a terminal: a panel, one small table, and what to type next."""

from __future__ import annotations

import os
import re
import shlex
import textwrap
from collections.abc import Sequence
from pathlib import Path

from rich.box import ROUNDED
from rich.console import Console
from rich.panel import Panel
from rich.text import Text

from jouleswarm.common.invoked import FETCH, executable
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import CAUSES
from jouleswarm.energy.carbon import has_carbon
from jouleswarm.report.answer import Said, factor_text, short_labels
from jouleswarm.report.arms import labels
from jouleswarm.report.format import grams_text, joules_text
from jouleswarm.report.table import Table, show
from jouleswarm.runs.answer import Answer, Spent
from jouleswarm.runs.directory import STATE
from jouleswarm.runs.run import Run

_TITLE = "What each arm learned and cost"
_GLUE = "\N{NO-BREAK SPACE}"
_WIDEST = 100
"""Sentences are read best in lines that are no longer."""
_SIDE_BY_SIDE = 3
"""Arms that are columns; more are rows."""


def show_answer(run: Run, energy: Energy, found: Answer, told: Said, console: Console) -> None:
    """Print all of it."""
    console.print(panel(told, min(_WIDEST, console.width)))
    show(arms_table(run, energy, found), console)


def panel(told: Said, width: int) -> Panel:
    """Title and lines, so many characters wide; broken between words, never cut, and numbers keep their units."""
    inside = width - 4  # two edges, and a blank beside each
    names = max((len(what) for what, _ in told.lines), default=0)
    text = Text()
    for line, style in ((told.changed, ""), (told.title, "bold")):
        if line:
            text.append(_wrapped(line, inside) + "\n", style=style)
    for what, words in told.rows:
        text.append(f"{what:{names}}  ", style="dim")
        text.append(_wrapped(words, inside - names - 2).replace("\n", "\n" + " " * (names + 2)) + "\n")
    text.rstrip()
    return Panel(text, box=ROUNDED, width=width, padding=(0, 1))


def _wrapped(line: str, width: int) -> str:
    """In lines of so many characters; a number is not parted from the word behind it."""
    glued = re.sub(r"(?<=\d) (?=[A-Za-z])", _GLUE, line)
    return "\n".join(textwrap.wrap(glued, max(width, 1), break_on_hyphens=False)).replace(_GLUE, " ")


def arms_table(run: Run, energy: Energy, found: Answer) -> Table:
    """What each arm learned and cost: a column an arm, or where there are many a row."""
    names = labels(run.scenario)
    if len(found.arms) > _SIDE_BY_SIDE:
        rows = [[names[arm], _learned(spent), _rounds(spent), joules_text(spent.total_j), _factor(found, arm)]
                for arm, spent in found.arms.items()]  # fmt: skip
        return Table(
            _TITLE, ["arm", "learned", "rounds", "energy", f"times {short_labels(run.scenario)[found.plain]}"], rows
        )
    spent = list(found.arms.values())
    rows = [["tasks learned", *map(_learned, spent)], ["rounds", *map(_rounds, spent)]]
    for cause in CAUSES:
        held = [each.by_cause_j[cause.key] for each in spent]
        if any(held):
            rows.append([cause.label, *map(joules_text, held)])
    rows.append(["energy", *(joules_text(each.total_j) for each in spent)])
    styles = {len(rows) - 1: "bold"}
    if has_carbon(energy):
        rows.append(["gCO2e", *(grams_text(each.carbon_g) for each in spent)])
    return Table(_TITLE, ["", *(names[each.arm] for each in spent)], rows, styles=styles)


def show_next(run: Run, written: Sequence[Path], console: Console) -> None:
    """Print where the files are, and what may be typed next; lines that can be pasted, however wide the terminal is."""
    page = next((path for path in written if path.suffix == ".html"), None)
    told = commands(run)
    if FETCH in os.environ:  # of a container: its files lie in a folder of the same name once they are fetched
        told = [("fetch its files", os.environ[FETCH]), *told]
    folder = Path(str(run.path).removeprefix("/")) if FETCH in os.environ else run.path
    lines = [f"run directory: {folder}", *([f"open in a browser: {folder / page.name}"] if page else [])]
    lines += [f"{what}: {command}" for what, command in told]
    for line in lines:
        console.print(line, markup=False, highlight=False, soft_wrap=True)


def commands(run: Run) -> list[tuple[str, str]]:
    """(what for, what to type) next; each can be pasted as it is."""
    program, folder = executable(), shlex.quote(str(run.path))
    report = f"{program} report {folder}"
    told = [("all tables", f"{report} --details"), ("other prices", f"{report} --ul 500 --sl 200")]
    if run.status != "complete" and (run.path / STATE).is_dir():
        told.insert(0, ("go on with it", f"{program} run --resume {folder}"))
    return told


def _learned(spent: Spent) -> str:
    return f"{spent.learned} of {spent.tasks}"


def _rounds(spent: Spent) -> str:
    return f"{spent.t0} + {spent.rounds:g}" if spent.t0 else f"{spent.rounds:g}"


def _factor(found: Answer, arm: str) -> str:
    if arm == found.plain:
        return "1" if found.against else "-"
    return next((factor_text(each.factor) for each in found.against if each.arm == arm), "-")
