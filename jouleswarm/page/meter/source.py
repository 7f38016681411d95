"""A meter's run directory, which may be written while it is read."""

from __future__ import annotations

from pathlib import Path

from jouleswarm.common.disk.lock import is_held
from jouleswarm.common.meter.counts_file import COUNTS
from jouleswarm.metering.directory import FACTS, MANIFEST, METER, SUMMARY, WINDOWS
from jouleswarm.metering.metered import load_metered
from jouleswarm.page.meter.model import MeterShown, meter_shown
from jouleswarm.page.source import Anew

_FILES = (MANIFEST, METER, WINDOWS, FACTS, SUMMARY, COUNTS)


class MeterFolder:
    """What the page is of, as `page.source.Source` has it."""

    def __init__(self, path: Path) -> None:
        self.path, self.title, self.where = path, path.name, str(path)
        self._anew = Anew(self._read)

    def look(self) -> MeterShown | None:
        """Reads again what has changed."""
        held = is_held(self.path)
        return self._anew.look((held, *(_stamp(self.path / name) for name in _FILES)), held=held)

    def _read(self, held: bool) -> MeterShown:
        metered = load_metered(self.path)
        return meter_shown(metered, running=held and not metered.is_complete)


def _stamp(path: Path) -> tuple[int, int]:
    """Of a file that is replaced whole."""
    if not path.exists():
        return 0, 0
    told = path.stat()
    return told.st_size, told.st_mtime_ns
