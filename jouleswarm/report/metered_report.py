"""`jouleswarm report` of a meter's run directory."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from rich.console import Console

from jouleswarm.common.disk.lock import is_held
from jouleswarm.common.disk.trouble import full_disk_is_told
from jouleswarm.common.errors import RunError, usable
from jouleswarm.common.meter.counts_bus import TOPIC
from jouleswarm.common.scenario.reading import Override
from jouleswarm.metering.metered import Metered
from jouleswarm.report.calculated import calculated, calculated_tables
from jouleswarm.report.metered import metered_tables
from jouleswarm.report.pages import rendered
from jouleswarm.report.table import show


def report_metered(
    metered: Metered, changes: Iterable[Override] = (), *, html_too: bool = False, console: Console | None = None
) -> list[Path]:
    """Print the bill of what was metered, and what was; and write `report.html` if asked. Returns the files written.

    Raises:
        ConfigurationError: a price that is no price, or asks for what was not metered.
        RunError: the page can't be written.
    """
    tariff, suffix = metered.priced(changes)
    bill = calculated_tables(calculated(metered.bill_rows, tariff)) if metered.bill_rows else []
    tables, console = [*bill, *metered_tables(metered, tariff)], console or Console()
    line = _headline(metered)
    console.print(f"{metered.name}: {line}", highlight=False)
    for table in tables:
        show(table, console)
    if not html_too:
        return []
    manifest = json.dumps(metered.manifest, indent=2)
    text = rendered("metered.html.j2", name=metered.name, headline=line, tables=tables, manifest=manifest)
    path = metered.path / f"report{suffix}.html"
    with full_disk_is_told(str(metered.path)), usable("run directory", metered.path, RunError):
        path.write_text(text, encoding="utf-8")
    return [path]


def _headline(metered: Metered) -> str:
    status = "running" if not metered.is_complete and is_held(metered.path) else metered.status
    heard = {row.client for row in metered.rows if row.topic and not row.topic.startswith(TOPIC)}
    nameless = " and those without an id" if "" in heard else ""
    nothing = "" if metered.bill_rows else "; nothing passed that a rule prices"
    return f"metered since {metered.manifest['started']}, {status}, {len(heard - {''})} clients{nameless}{nothing}"
