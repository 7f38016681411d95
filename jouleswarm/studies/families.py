"""The tests of a study at the t0 that it is about: whether transfer saves rounds, in two families of hypotheses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from jouleswarm.report.table import Cell, Table, number
from jouleswarm.studies.ratio_tables import bounded_text, p_text
from jouleswarm.studies.ratios import FULL, Row
from jouleswarm.studies.significance import holm

PRIMARY, SECONDARY = "primary", "secondary"
LEVEL = 0.05


class Finding(NamedTuple):
    """One hypothesis, with p by Holm over its own family."""

    family: str
    row: Row

    @property
    def saves(self) -> str:
        """`yes`, `costs` where it takes more rounds, or `not shown`."""
        p, gain = self.row.p_holm, self.row.gain.of_means.value
        if p is None or p >= LEVEL or gain == 1:
            return "not shown"
        return "yes" if gain > 1 else "costs"


def findings(rows: Sequence[Row], t0: int) -> list[Finding]:
    """Rounds by the full window: unseen tasks at `t0`, all methods, are the primary family; unseen tasks at all other
    t0 and seen ones at every t0 the secondary one. Nothing where `t0` is of no arm."""
    held = [row for row in rows if row.measure == FULL and row.tasks in ("unseen", "seen")]
    primary = [row for row in held if (row.tasks, row.t0) == ("unseen", t0)]
    if not primary:
        return []
    families = {PRIMARY: primary, SECONDARY: [row for row in held if row not in primary]}
    return [
        Finding(name, row._replace(p_holm=p))
        for name, family in families.items()
        for row, p in zip(family, holm([row.p for row in family]), strict=True)
    ]


def findings_csv(found: Sequence[Finding]) -> Table:
    """A row a hypothesis."""
    cells: list[tuple[Cell, ...]] = []
    for family, row in found:
        means = (row.seeds, row.without, row.with_, *row.gain.of_means)
        cells.append((family, row.method, row.t0, row.tasks, *means, row.p, row.p_holm, Finding(family, row).saves))
    ratio = ("ratio_of_means", "ratio_of_means_low95", "ratio_of_means_high95")
    head = ("family", "method", "t0", "tasks", "seeds", "without", "with", *ratio, "p", "p_holm", "saves")
    return Table("Tests", head, cells)


def findings_markdown(found: Sequence[Finding]) -> Table:
    """For readers."""
    rows: list[tuple[Cell, ...]] = [
        (each.family, row.tasks, row.method, row.t0, row.seeds, number(row.without), number(row.with_),
         bounded_text(row, row.gain.of_means), p_text(row), each.saves)
        for each in found
        for row in [each.row]
    ]  # fmt: skip
    told = (
        "t_i by the full window, summed over the group's tasks. p is of Wilcoxon's signed-rank test over seeds, exact, "
        f"two-sided, by Holm over the rows of its family; `yes` and `costs` below {LEVEL:g}."
    )
    headings = (
        "family",
        "tasks",
        "method",
        "t0",
        "seeds",
        "t_i without",
        "with",
        "without / with",
        "p (Holm)",
        "saves",
    )
    return Table("Does transfer save rounds?", headings, rows, (told,))
