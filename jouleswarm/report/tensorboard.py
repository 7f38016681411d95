"""A run as TensorBoard's event files, while it goes on and afterwards: a folder for each arm, its "run"."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rich.console import Console

from jouleswarm.common.errors import ConfigurationError, usable
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.report.scalars import Growing, Heard, Scalar, scalars
from jouleswarm.runs.run import Run


class LiveEvents:
    """A follower (see fleet/following.py) that writes into FOLDER/RUN/ARM, one more file each time it goes on."""

    def __init__(self, folder: Path) -> None:
        """
        Raises:
            ConfigurationError: tensorboard is not installed, or the folder cannot be written into.
        """
        self._make, self._folder = _writer_class("--tensorboard"), folder
        with usable("--tensorboard", folder):
            folder.mkdir(parents=True, exist_ok=True)
        self._writers: dict[str, Any] = {}

    def begin(self, console: Console, scenario: Scenario, recorder: Heard) -> None:
        self._console, self._growing = console, Growing(scenario, recorder.spent)
        self._tell(f"TensorBoard: tensorboard --logdir {self._folder}")
        try:
            own = self._folder / recorder.run
            self._writers = {arm: self._make(str(own / arm)) for arm in scenario.arm_names}
        except OSError as error:
            self._give_up(error)

    def take(self, row: RoundRow) -> None:
        self._write(self._growing.take(row))

    def update(self) -> None:
        try:
            for writer in self._writers.values():
                writer.flush()
        except OSError as error:
            self._give_up(error)

    def end(self, run: Run) -> None:
        self._write(self._growing.end(run))

    def close(self) -> None:
        self.update()
        for writer in self._writers.values():
            writer.close()

    def _write(self, news: Iterable[tuple[str, Scalar]]) -> None:
        try:
            for arm, scalar in news:
                if arm in self._writers:
                    _add(self._writers[arm], scalar)
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self._writers = {}
        self._tell(f"TensorBoard: {self._folder} cannot be written ({error.strerror}); the run goes on without")

    def _tell(self, line: str) -> None:
        self._console.print(line, highlight=False, markup=False, soft_wrap=True)


def write_events(run: Run, folder: Path) -> list[Path]:
    """Write a folder for each arm; gives them.

    Raises:
        ConfigurationError: tensorboard is not installed, or an arm's folder has events already.
    """
    make = _writer_class("--to tensorboard")
    folders = [folder / arm for arm in run.scenario.arm_names]
    for each in folders:
        if any(each.glob("events.out.tfevents.*")):
            raise ConfigurationError(f"{each} has events already, which would be shown twice; name another --out")
    with usable("--out", folder):
        for arm, each in zip(run.scenario.arm_names, folders, strict=True):
            writer = make(str(each))
            for scalar in scalars(run, arm):
                _add(writer, scalar)
            writer.close()
    return folders


def _writer_class(option: str) -> Any:
    try:
        from tensorboard.summary import Writer
    except ImportError as error:
        raise ConfigurationError(f"{option} needs TensorBoard: pip install jouleswarm[tensorboard]") from error
    return Writer


def _add(writer: Any, scalar: Scalar) -> None:
    writer.add_scalar(scalar.name, scalar.value, scalar.round, wall_time=scalar.time_s or None)
