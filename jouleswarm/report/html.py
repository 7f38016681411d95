"""`report.html`: one file with everything in it, that works from a disk without a network, for mailing and keeping.

Its charts are SVG that a short script of ours draws: a chart library would be larger than all the rest of the page.
"""

from __future__ import annotations

import json
from pathlib import Path

from markupsafe import Markup

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.report.answer import answer, said
from jouleswarm.report.drawings import Paths, map_svg, topology_svg
from jouleswarm.report.figures import CAPTIONS, inline_svgs
from jouleswarm.report.kept_paths import kept_paths
from jouleswarm.report.notes import headline, notes, warnings
from jouleswarm.report.page_data import page_data
from jouleswarm.report.pages import rendered
from jouleswarm.report.screen import arms_table
from jouleswarm.report.tables import energy_table, report_tables
from jouleswarm.report.why import why_tables
from jouleswarm.runs.paths import LANDMARKS
from jouleswarm.runs.run import Run


def write_html(run: Run, energy: Energy, suffix: str = "") -> Path:
    """Write `report<suffix>.html` into the run directory; returns its path."""
    path = run.path / f"report{suffix}.html"
    path.write_text(page(run, energy, kept_paths(run)), encoding="utf-8")
    return path


def page(run: Run, energy: Energy, paths: Paths | None = None) -> str:
    """The report as one HTML document without anything from elsewhere; `paths`: of greedy episodes, to be drawn."""
    found, tables = answer(run, energy), [*report_tables(run, energy), *why_tables(run, energy)]
    maps = run.scenario.clusters if run.scenario.environment == LANDMARKS else ()
    return rendered(
        "report.html.j2",
        script="report.js",
        name=run.name,
        warnings=warnings(run),
        told=said(run, energy, found),
        headline=headline(run, energy),
        arms_table=arms_table(run, energy, found),
        tables=[*tables, *(energy_table(run, arm, energy) for arm in run.scenario.arm_names)],
        figures=[(CAPTIONS[name], Markup(svg)) for name, svg in inline_svgs(run, energy).items()],  # ours
        maps=[(task, map_svg(run.scenario, task, paths or {})) for task in maps],
        has_paths=bool(paths),
        topology=topology_svg(run.scenario),
        notes=notes(run, energy),
        manifest=json.dumps(run.manifest, indent=2),
        data=page_data(run, energy, found),
    )
