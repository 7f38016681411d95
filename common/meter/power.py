"""Where joules are read: the processor's own counter (RAPL), a GPU's (NVML), or an estimate by CPU time.

A processor's counter is of the whole package, whoever computes: a process is booked its share of the machine's CPU
time. A GPU's is of the whole device: nobody else should compute there.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from jouleswarm.common.scenario.measure import Measure

log = logging.getLogger("jouleswarm.meter")

POWERCAP, STAT = Path("/sys/class/powercap"), Path("/proc/stat")
RAPL, NVML = "rapl", "nvml"
_IDLE = slice(3, 5)  # idle and iowait of /proc/stat's first line (proc(5)); after the eighth, guests are in user too


class Rated(NamedTuple):
    """What the estimate needs to know, as `Measure` has it."""

    tdp_w: float = 85.0
    share: float = 1.0
    cores: int | None = None


class Processor(Protocol):
    """What tells joules of a process on the processor."""

    how: str

    def joules(self, cpu_s: float) -> float:
        """Drawn since the last call by a process that has computed for `cpu_s` since then, in all its threads."""


class Estimate:
    """CPU time x the share of TDP that a core has: no counter, and no watt for waiting."""

    def __init__(self, settings: Measure | Rated) -> None:
        self.watts = settings.tdp_w * settings.share / (settings.cores or os.cpu_count() or 1)
        self.how = f"estimated: CPU time x {self.watts:.4g} W"

    def joules(self, cpu_s: float) -> float:
        return self.watts * cpu_s


class Rapl:
    """Running Average Power Limit of Intel and AMD, as Linux shows it (Documentation/power/powercap)."""

    how = RAPL

    def __init__(self, powercap: Path = POWERCAP, stat: Path = STAT) -> None:
        """
        Raises:
            OSError: there is none, or this user may not read it.
        """
        zones = sorted(powercap.glob("intel-rapl:*"))
        packages = [zone for zone in zones if (zone / "name").read_text().startswith("package")]
        if not packages:
            raise FileNotFoundError(f"no package under {powercap}")
        # The counter begins again at 0 after this.
        self._packages = {zone / "energy_uj": int((zone / "max_energy_range_uj").read_text()) + 1 for zone in packages}
        self._stat, self._tick_s = stat, 1 / os.sysconf("SC_CLK_TCK")
        self._drawn_uj, self._busy_s = self._read(), self._busy()

    def joules(self, cpu_s: float) -> float:
        drawn_uj, busy_s = self._read(), self._busy()
        ranges = self._packages.values()
        uj = sum((now - then) % size for now, then, size in zip(drawn_uj, self._drawn_uj, ranges, strict=True))
        others_too_s = max(busy_s - self._busy_s, cpu_s)  # the kernel counts it in whole ticks
        self._drawn_uj, self._busy_s = drawn_uj, busy_s
        return uj * 1e-6 * cpu_s / others_too_s if cpu_s else 0.0

    def _read(self) -> list[int]:
        return [int(file.read_text()) for file in self._packages]

    def _busy(self) -> float:
        with self._stat.open() as file:
            ticks = [int(each) for each in file.readline().split()[1:9]]
        return (sum(ticks) - sum(ticks[_IDLE])) * self._tick_s


class Nvml:
    """A GPU's counter since its driver was loaded (nvmlDeviceGetTotalEnergyConsumption, Volta and later)."""

    how = NVML

    def __init__(self, uuid: str) -> None:
        """
        Args:
            uuid: of the device, as PyTorch tells it.

        Raises:
            ImportError: nvidia-ml-py is not installed.
            pynvml.NVMLError: the device or its driver has no such counter.
        """
        import pynvml

        pynvml.nvmlInit()
        handle = pynvml.nvmlDeviceGetHandleByUUID(f"GPU-{uuid}")
        self._read: Callable[[], int] = lambda: int(pynvml.nvmlDeviceGetTotalEnergyConsumption(handle))
        self._drawn_mj = self._read()

    def joules(self) -> float:
        """Drawn since the last call, by whoever computes there."""
        before, self._drawn_mj = self._drawn_mj, self._read()
        return float(self._drawn_mj - before) * 1e-3


def processor(settings: Measure | Rated) -> Processor:
    """RAPL where it can be read, else the estimate."""
    try:
        return Rapl()
    except OSError:
        return Estimate(settings)


def gpu(uuid: str | None) -> Nvml | None:
    """The counter of a GPU, if there is a GPU and it has one; else its joules stay unknown, and a warning says so."""
    if uuid is None:
        return None
    try:
        import pynvml
    except ImportError:
        log.warning("the GPU's joules are not measured: `pip install jouleswarm[measure]`")
        return None
    try:
        return Nvml(uuid)
    except pynvml.NVMLError as error:
        log.warning("the GPU's joules are not measured: NVML: %s", error)
        return None


def told(settings: Measure) -> str:
    """How this machine's joules are had, in one line."""
    here = processor(settings)
    if isinstance(here, Estimate):
        cores = settings.cores or os.cpu_count()
        return (
            f"measured joules: no readable counter here ({POWERCAP}/intel-rapl*), so {here.how} of a busy core "
            f"(measure.tdp_w {settings.tdp_w:g} x share {settings.share:g} / {cores} cores)"
        )
    return f"measured joules: {here.how}, by each process's share of the machine's CPU time"
