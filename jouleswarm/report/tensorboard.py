"""A run as TensorBoard's event files."""

from __future__ import annotations

from pathlib import Path

from jouleswarm.common.errors import ConfigurationError, usable
from jouleswarm.report.scalars import scalars
from jouleswarm.runs.run import Run


def write_events(run: Run, folder: Path) -> list[Path]:
    """Write a folder for each arm, which TensorBoard shows as a run of its own; gives them.

    Raises:
        ConfigurationError: tensorboard is not installed, or an arm's folder has events already.
    """
    try:
        from tensorboard.summary import Writer
    except ImportError as error:
        raise ConfigurationError("--to tensorboard needs it: pip install jouleswarm[tensorboard]") from error
    folders = [folder / arm for arm in run.scenario.arm_names]
    for each in folders:
        if any(each.glob("events.out.tfevents.*")):
            raise ConfigurationError(f"{each} has events already, which would be shown twice; name another --out")
    with usable("--out", folder):
        for arm, each in zip(run.scenario.arm_names, folders, strict=True):
            writer = Writer(str(each))
            for scalar in scalars(run, arm):
                writer.add_scalar(scalar.name, scalar.value, scalar.round, wall_time=scalar.time_s or None)
            writer.close()
    return folders
