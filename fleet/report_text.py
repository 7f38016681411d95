"""The words and tables of a report, whatever they are shown on."""

from __future__ import annotations

from dataclasses import dataclass

from common.energy import PUBLISHED_SL_BIT_PER_J, PUBLISHED_UL_BIT_PER_J, downlink_bit_per_j
from common.settings import Energy
from common.topics import Link
from fleet.report_columns import PARTS, columns, control_j
from fleet.report_data import Run
from fleet.traffic import metered_by, traffic

ARM_NAMES = {"maml": "with MAML", "fl": "without MAML"}
PART_NAMES = {
    "ml_learning": "MAML learning",
    "ml_communication": "MAML traffic",
    "ml": "E_ML, eq. (8)",
    "fl_learning": "FL learning",
    "fl_communication": "FL traffic",
    "fl": "E_FL, eq. (10)",
    "total": "E, eq. (12)",
}
_NOTHING = "-"


@dataclass(frozen=True)
class TextTable:
    """A table as text; the first column is left-aligned, `strong` are the numbers of rows that stand out."""

    title: str
    headings: list[str]
    rows: list[list[str]]
    strong: frozenset[int] = frozenset()


def headline(run: Run, energy: Energy) -> str:
    """One line: how the run ended and what it is priced at."""
    return (
        f"{run.status}, seed {run.scenario.seed}, t0 = {run.t0}; E_UL {energy.ul_bit_per_j / 1e3:g}, "
        f"E_DL {downlink_bit_per_j(energy) / 1e3:g}, E_SL {energy.sl_bit_per_j / 1e3:g} kb/J, "
        f"sidelinks {energy.sidelink.replace('_', ' ')}, PUE {energy.pue:g}, beta {energy.beta:g}"
    )


def rounds_table(run: Run) -> TextTable:
    """Rounds, reward and path error of each task, arm beside arm."""
    headings = ["task"]
    for arm in run.scenario.arm_names:
        headings += [f"{heading} {ARM_NAMES[arm]}" for heading in ("t_i", "R", "RMSE (m)", "learned")]
    rows = []
    for place, task in enumerate(run.scenario.clusters):
        cells = [str(task)]
        for arm in run.scenario.arm_names:
            found = run.results[arm][place]
            cells += [str(found.rounds), number_text(found.reward), number_text(found.rmse_m, 2)]
            cells.append("yes" if found.learned else "no")
        rows.append(cells)
    sums = [cell for arm in run.scenario.arm_names for cell in (f"{sum(run.rounds(arm).values()):g}", "", "", "")]
    return TextTable(
        "Rounds, running reward R and path error", headings, [*rows, ["sum", *sums]], frozenset({len(rows)})
    )


def energy_table(run: Run, arm: str, energy: Energy) -> TextTable:
    """An arm's energy by stage and cause, one column a way to know it."""
    held = columns(run, arm, energy)
    rows = [[PART_NAMES[part], *(joules_text(column.joules[part]) for column in held)] for part in PARTS]
    strong = frozenset(PARTS.index(part) for part in ("ml", "fl", "total"))
    return TextTable(f"Energy {ARM_NAMES[arm]}", ["", *(column.label for column in held)], rows, strong)


def bytes_table(run: Run, energy: Energy) -> TextTable:
    """What was delivered over each link class, and what carrying it cost in protocol bytes."""
    rows = []
    for arm in run.scenario.arm_names:
        for link in Link:
            found = traffic(run.meter_rows, arm, link)
            overhead = "-" if found.overhead is None else f"{100 * found.overhead:.3f}%"
            price = joules_text(control_j(run, arm, energy)) if link == Link.CONTROL else ""
            sizes = (bytes_text(found.payload), bytes_text(found.packet))
            rows.append([f"{link.value} {ARM_NAMES[arm]}", f"{found.messages:,}", *sizes, overhead, price])
    headings = ["link", "messages", "payload", "whole packets", "overhead", "would cost"]
    return TextTable("Bytes delivered by link class", headings, rows)


def joules_text(joules: float | None) -> str:
    """Joules to four digits, "-" where not defined or not known; a small run stands beside the paper's large one."""
    if joules is None:
        return _NOTHING
    for unit, factor in (("MJ", 1e6), ("kJ", 1e3)):
        if joules >= factor:
            return f"{joules / factor:.4g} {unit}"
    return f"{joules:.4g} J"


def number_text(value: float | None, decimals: int = 1) -> str:
    """A number, "-" for None."""
    return _NOTHING if value is None else f"{value:.{decimals}f}"


def bytes_text(size_bytes: float) -> str:
    """Bytes in a unit that keeps four digits."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= factor:
            return f"{size_bytes / factor:.4g} {unit}"
    return f"{size_bytes:.0f} B"


def verdicts(run: Run, energy: Energy) -> list[str]:
    """Whether meta-learning pays, by each column that has a total for both arms."""
    if set(run.scenario.arm_names) != {"maml", "fl"}:
        return []
    lines = []
    for ours, theirs in zip(columns(run, "maml", energy), columns(run, "fl", energy), strict=True):
        ours_j, theirs_j = ours.joules["total"], theirs.joules["total"]
        if ours_j and theirs_j is not None:
            ratio = theirs_j / ours_j
            pays = "pays" if ratio > 1 else "does not pay"
            lines.append(f"meta-learning {pays}: {ratio:.2f}x ({theirs.label.split(' (')[0]})")
    return lines


def notes(run: Run, energy: Energy) -> list[str]:
    """What a reader must know before quoting a figure of this report."""
    lines = [
        *_notes_of_the_run(run),
        "Column paper is as printed, all others are for this run's rounds. The last four are equations (8)-(12), with "
        "Table I's batches and bytes, with the scenario's, and with gradients and bytes as counted, without and with "
        "MQTT's own bytes.",
    ]
    here = (energy.ul_bit_per_j, energy.sl_bit_per_j, energy.sidelink)
    if here == (PUBLISHED_UL_BIT_PER_J, PUBLISHED_SL_BIT_PER_J, "direct"):
        lines.append(
            "Published prices: 352.4 J a MAML round and 246.3 J an FL round of the paper's deployment, whatever PUE, "
            "beta and sizes are; the paper does not tell learning from communication."
        )
    else:
        lines.append("Published prices are defined for direct sidelinks at (E_UL, E_SL) = (200, 500) kb/J only.")
    if energy.dl_bit_per_j is None:
        lines.append("E_DL is not given by the paper and taken as E_UL.")
    lines.append("Control and telemetry are counted apart and in no bill.")
    return lines


def _notes_of_the_run(run: Run) -> list[str]:
    lines = []
    source = metered_by(run.meter_rows)
    if run.status != "complete":
        lines.append(f"This run is {run.status}: figures cover what was recorded.")
    if run.cut:
        lines.append(f"The last line of {' and '.join(run.cut)} is torn and left out.")
    if source is None:
        lines.append("No byte counters were written: measured communication is not known, columns of it are empty.")
    elif source == "client":
        lines.append("Metered by the clients themselves: an external broker counts no bytes for us.")
    unlearned = [
        f"task {found.task} {ARM_NAMES[arm]}"
        for arm in run.scenario.arm_names
        for found in run.results[arm]
        if not found.learned
    ]
    if unlearned:
        lines.append(f"Not learned: {', '.join(unlearned)}. Energies are not at equal reward.")
    return lines
