"""`report.html`: one file with everything in it, readable in light and in dark, for mailing and keeping."""

from __future__ import annotations

import html
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.report.answer import Said, answer, said
from jouleswarm.report.figures import CAPTIONS, inline_svgs
from jouleswarm.report.notes import headline, notes, warnings
from jouleswarm.report.screen import arms_table
from jouleswarm.report.table import html_text
from jouleswarm.report.tables import energy_table, report_tables
from jouleswarm.report.why import why_tables
from jouleswarm.runs.run import Run

_STYLE = """
:root { color-scheme: light dark; --ink: #1d1d24; --soft: #62626e; --paper: #fcfcfd; --card: #fff; --line: #dcdce4;
  --accent: #b06f00; }
@media (prefers-color-scheme: dark) { :root { --ink: #e9e9ee; --soft: #a0a0ad; --paper: #16161b; --card: #1e1e25;
  --line: #383844; --accent: #f0b040; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 16px/1.55 system-ui, sans-serif; }
main { max-width: 62rem; margin: 0 auto; padding: 2.5rem 1.25rem 5rem; }
h1 { font-size: 1.7rem; margin: 0; } h2 { font-size: 1.15rem; margin: 2.8rem 0 .7rem; }
p { margin: .4rem 0; } .soft, figcaption { color: var(--soft); font-size: .9rem; }
.answer dl { display: grid; grid-template-columns: max-content 1fr; gap: .25rem 1rem; margin: 1.2rem 0; }
.answer dt { color: var(--soft); } .answer dd { margin: 0; }
.verdict { border-left: 4px solid var(--accent); padding: .15rem .9rem; margin: 1.4rem 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: .88rem; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .38rem .6rem; border-bottom: 1px solid var(--line); vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; } th { font-weight: 600; color: var(--soft); }
tr.bold td { font-weight: 700; border-bottom-width: 2px; }
figure { margin: 1.2rem 0; padding: 1rem; background: var(--card); border: 1px solid var(--line); border-radius: 8px; }
figure svg { width: 100%; height: auto; display: block; } figcaption { margin-top: .6rem; }
pre { overflow-x: auto; background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: 1rem;
  font-size: .8rem; line-height: 1.4; }
"""


def write_html(run: Run, energy: Energy, suffix: str = "") -> Path:
    """Write `report<suffix>.html` into the run directory; returns its path."""
    path = run.path / f"report{suffix}.html"
    path.write_text(page(run, energy), encoding="utf-8")
    return path


def page(run: Run, energy: Energy) -> str:
    """The report as one HTML document without anything from elsewhere."""
    name, found = html.escape(run.name), answer(run, energy)
    figures = (
        f"<figure>{svg}<figcaption>{html.escape(CAPTIONS[figure])}</figcaption></figure>"
        for figure, svg in inline_svgs(run, energy).items()
    )
    body = [
        paragraphs(warnings(run), "verdict"),
        answer_html(said(run, energy, found)),
        html_text(arms_table(run, energy, found)),
        f'<p class="soft">{name}: {html.escape(headline(run, energy))}</p>',
        *map(html_text, report_tables(run, energy)),
        *figures,
        *map(html_text, why_tables(run, energy)),
        *(html_text(energy_table(run, arm, energy)) for arm in run.scenario.arm_names),
        "<h2>Notes</h2>",
        paragraphs(notes(run, energy), "soft"),
        manifest_text(run.manifest, "Scenario, versions and host"),
    ]
    return document(run.name, body)


def document(title: str, body: Iterable[str]) -> str:
    """A page of parts that are HTML."""
    name = html.escape(title)
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{name}</title>'
    return (
        f'<!doctype html><html lang="en"><head>{head}<style>{_STYLE}</style></head>'
        f"<body><main>{''.join(body)}</main></body></html>\n"
    )


def manifest_text(manifest: Mapping[str, Any], what: str) -> str:
    """A section to be opened, with all of it."""
    text = html.escape(json.dumps(manifest, indent=2))
    return f"<h2>Manifest</h2><details><summary>{what}</summary><pre>{text}</pre></details>"


def answer_html(told: Said) -> str:
    """The answer of a run, that stands before everything else on its page."""
    lines = "".join(f"<dt>{html.escape(what)}</dt><dd>{html.escape(words)}</dd>" for what, words in told.rows)
    changed = f"<p>{html.escape(told.changed)}</p>" if told.changed else ""
    return f'<section class="answer">{changed}<h1>{html.escape(told.title)}</h1><dl>{lines}</dl></section>'


def paragraphs(lines: Sequence[str], name: str) -> str:
    """A line each; `name` is how they look."""
    inside = "".join(f"<p>{html.escape(line)}</p>" for line in lines)
    return f'<div class="{name}">{inside}</div>' if lines else ""
