"""What `jouleswarm chaos` tells of its faults: a table, and the same for programs."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from rich import box
from rich.table import Table

from jouleswarm.chaos.plan import Fault


def chaos_table(faults: Sequence[Fault]) -> Table:
    """One row a fault."""
    identical = sum(fault.identical is True for fault in faults)
    table = Table(title=f"{len(faults)} faults, {identical} of them in runs with an identical end", box=box.SIMPLE)
    for heading in ("run", "phase", "fault", "done to", "recovery, s", "identical", "bytes fit", ""):
        table.add_column(heading, justify="right" if heading.endswith(" s") else "left")
    for fault in faults:
        recovery = "-" if fault.recovery_s is None else f"{fault.recovery_s:.1f}"
        said = [{True: "yes", False: "NO", None: "?"}[each] for each in (fault.identical, fault.conserved)]
        table.add_row(fault.run, fault.phase, fault.kind, fault.target, recovery, *said, fault.note)
    return table


def chaos_csv(faults: Sequence[Fault]) -> str:
    """The table for programs."""
    lines = io.StringIO()
    table = csv.writer(lines, lineterminator="\n")
    table.writerow(["run", "phase", "fault", "target", "at_s", "recovery_s", "identical", "bytes_fit", "note"])
    for each in faults:
        recovery = "" if each.recovery_s is None else f"{each.recovery_s:.2f}"
        cells = (each.run, each.phase, each.kind, each.target, f"{each.at_s:.2f}", recovery)
        table.writerow([*cells, each.identical, each.conserved, each.note])
    return lines.getvalue()
