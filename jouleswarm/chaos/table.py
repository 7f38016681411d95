"""What `jouleswarm chaos` tells of its faults: a table, and the same for programs."""

from __future__ import annotations

from collections.abc import Sequence

from jouleswarm.chaos.plan import Fault
from jouleswarm.report.table import Table, csv_text

_SAID = {True: "yes", False: "NO", None: "?"}


def chaos_table(faults: Sequence[Fault]) -> Table:
    """One row a fault."""
    rows = []
    for each in faults:
        recovery = "-" if each.recovery_s is None else f"{each.recovery_s:.1f}"
        said = _SAID[each.identical], _SAID[each.conserved]
        rows.append((each.run, each.phase, each.kind, each.target, recovery, *said, each.note))
    identical = sum(fault.identical is True for fault in faults)
    title = f"{len(faults)} faults, {identical} of them in runs with an identical end"
    return Table(title, ("run", "phase", "fault", "done to", "recovery, s", "identical", "bytes fit", ""), rows)


def chaos_csv(faults: Sequence[Fault]) -> str:
    """The table for programs."""
    rows = []
    for each in faults:
        recovery = "" if each.recovery_s is None else f"{each.recovery_s:.2f}"
        cells = (each.run, each.phase, each.kind, each.target, f"{each.at_s:.2f}", recovery)
        rows.append((*cells, each.identical, each.conserved, each.note))
    headings = ("run", "phase", "fault", "target", "at_s", "recovery_s", "identical", "bytes_fit", "note")
    return csv_text(Table("", headings, rows))
