"""A run as tables for other programs: CSV and Parquet."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Literal

import pandas as pd

from jouleswarm.common.errors import ConfigurationError, usable
from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price
from jouleswarm.metering.metered import Metered
from jouleswarm.report.arms import labels
from jouleswarm.runs.curves import curves
from jouleswarm.runs.run import Run


def frames(run: Run) -> dict[str, pd.DataFrame]:
    """By name: `rounds` (a row a robot and round; what else its environment measured as `measures.NAME`), `meter`,
    `curves` (what had been spent and learned after each round of an arm), `arms`, `joules` (by arm, phase, cause)."""
    rounds = [row.model_dump(mode="json") for row in run.rows]
    columns = [name for name in RoundRow.model_fields if name != "measures"]
    measures = sorted({f"measures.{name}" for row in run.rows for name in row.measures})
    named = [{**row, **{f"measures.{key}": value for key, value in row.get("measures", {}).items()}} for row in rounds]
    found = pd.DataFrame(named, columns=[*columns, *measures])
    found["missed"] = [" ".join(map(str, each)) for each in found["missed"]]
    meter = pd.DataFrame([row.model_dump(mode="json") for row in run.meter_rows], columns=[*MeterRow.model_fields])
    return {
        "rounds": found,
        "meter": meter,
        "curves": curves(run, run.scenario.energy),
        "arms": _arms(run),
        "joules": _joules(run),
    }


def metered_frames(metered: Metered) -> dict[str, pd.DataFrame]:
    """By name: `meter` (a row a client, direction and topic; labels as `labels.NAME`), `windows` (the same by time,
    without topics) and `facts` (what training loops told)."""
    windows = [
        {"begin_s": window.begin_s, "window_s": window.window_s, **asdict(row)}
        for window in metered.windows
        for row in window.rows
    ]
    return {
        "meter": pd.json_normalize([asdict(row) for row in metered.rows]),
        "windows": pd.json_normalize(windows),
        "facts": pd.json_normalize([dict(each) for each in metered.told]),
    }


def write_tables(run: Run | Metered, folder: Path, kind: Literal["csv", "parquet"]) -> list[Path]:
    """Write `frames` or `metered_frames`, each into a file of its own; those that are there are written anew.

    Raises:
        ConfigurationError: pyarrow is not installed, or the folder cannot be written into.
    """
    written = []
    with usable("--out", folder):
        folder.mkdir(parents=True, exist_ok=True)
        for name, frame in (metered_frames(run) if isinstance(run, Metered) else frames(run)).items():
            path = folder / f"{name}.{kind}"
            if kind == "csv":
                frame.to_csv(path, index=False)
            else:
                _write_parquet(frame, path)
            written.append(path)
    return written


def _write_parquet(frame: pd.DataFrame, path: Path) -> None:
    try:
        frame.to_parquet(path, index=False, engine="pyarrow")
    except ImportError as error:
        raise ConfigurationError("--to parquet needs pyarrow: pip install jouleswarm[export]") from error


def _arms(run: Run) -> pd.DataFrame:
    rows = []
    for arm in run.scenario.arms:
        results, facts = run.results[arm.name], run.facts[arm.name]
        bill = price(literal, facts, run.scenario.energy) if facts.metered else None
        rows.append(
            {
                "arm": arm.name,
                "label": labels(run.scenario)[arm.name],
                "method": arm.method,
                "t0": run.t0[arm.name],
                "tasks": len(results),
                "learned": sum(result.learned for result in results),
                "rounds": sum(result.rounds for result in results),
                "joules": None if bill is None else bill.total_j,
            }
        )
    return pd.DataFrame(rows)


def _joules(run: Run) -> pd.DataFrame:
    rows = []
    for arm, facts in run.facts.items():
        bill = price(literal, facts, run.scenario.energy) if facts.metered else None
        for phase, cost in () if bill is None else (("ml", bill.ml), ("fl", bill.fl)):
            rows += [(arm, phase, name.removesuffix("_j"), joules) for name, joules in asdict(cost).items() if joules]
    return pd.DataFrame(rows, columns=["arm", "phase", "cause", "joules"])
