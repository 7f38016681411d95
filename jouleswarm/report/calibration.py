"""What a calibration has measured: a table beside the paper's Table I, and lines for a file of constants."""

from __future__ import annotations

import datetime
from pathlib import Path

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.host import machine
from jouleswarm.common.scenario.documents import parse_toml
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.reading import energy_file
from jouleswarm.methods.calibration import ROBOT, Calibration
from jouleswarm.report.table import Table

_TABLE_I = Energy()


def calibration_table(found: Calibration, scenario: str, device: str) -> Table:
    """A row a constant."""
    t, p = ("tk_batch_s", "pk_w") if found.role == ROBOT else ("t0_batch_s", "p0_w")
    paper_s, paper_w = getattr(_TABLE_I, t), getattr(_TABLE_I, p)
    first, third = found.quartiles_s
    rows = [[t, _ms(found.batch_s), f"half within {_ms(first)} to {_ms(third)}", _ms(paper_s)]]
    if found.joules is None or found.watts is None:
        rows.append([p, "-", found.how, f"{paper_w:g} W"])
    else:
        rows.append(["joules a batch", f"{found.joules:.4g} J", found.how, f"{paper_s * paper_w:.4g} J"])
        rows.append([p, f"{found.watts:.4g} W", found.how, f"{paper_w:g} W"])
    if found.beta is not None:
        rows.append(["beta", f"{found.beta:.3g}", "exact MAML, by time", f"{_TABLE_I.beta:g}"])
    counted = f"{found.parameters:,} parameters, {len(found.seconds)} batch gradients"
    title = f"{found.role} on {device}: {scenario}, {counted}"
    return Table(title, ["", "here", "how", "paper, Table I"], rows)


def energy_lines(found: Calibration, scenario: str, device: str) -> dict[str, str]:
    """A scenario's section energy: key -> its line of TOML, which says how it was had."""
    where = str(machine()["processor"]) if device == "cpu" else device
    day = datetime.datetime.now(datetime.UTC).date()
    lines = {}
    for key, value in found.constants.items():
        how = found.how if key.endswith("_w") else "measured"
        lines[key] = f"{key} = {value:g}  # {how}; {scenario} on {where}, {day}"
    return lines


def check_writable(path: Path | None) -> None:
    """Look at where constants are to be written, before they are measured.

    Raises:
        ConfigurationError: it is there and no TOML file with a table [energy] alone, or its folder is not there.
    """
    if path is not None and path.exists():
        energy_file(path)
    elif path is not None and not path.parent.is_dir():
        raise ConfigurationError(f"--write {path}: there is no folder {path.parent}; make it, or name another file")


def write_energy(path: Path, lines: dict[str, str]) -> None:
    """Put lines into the table [energy] of a file, which may not be there yet; its other lines stay.

    Raises:
        ConfigurationError: what is there is not written line by line below [energy]; it stays.
        RunError: it cannot be written.
    """
    before = path.read_text(encoding="utf-8") if path.exists() else "[energy]\n"
    kept = [line for line in before.splitlines() if line.partition("=")[0].strip() not in lines]
    text = "\n".join([*kept, *lines.values()]) + "\n"
    if set(lines) - set(parse_toml(text).get("energy", {})):
        raise ConfigurationError(f"--write {path}: expected a line [energy] and one line a constant below it")
    write_whole(path, text.encode(), durable=False)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.4g} ms"
