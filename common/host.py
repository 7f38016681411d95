"""On what a process computes: sums round otherwise on another processor or by another build of a library.

The same scenario and seed give the same weights to the bit where `arithmetic` is the same; elsewhere perhaps others.
"""

from __future__ import annotations

import logging
import os
import platform
from functools import cache
from pathlib import Path
from typing import Any

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire.messages import MAX_PROCESSOR, Presence

log = logging.getLogger("jouleswarm.host")

PROCESSOR = "processor"
"""File in a state folder: what its states were computed on, a line each, the newest last."""

_CPU_INFO = Path("/proc/cpuinfo")
_NUMBERS = ("cpu family", "model", "cpu implementer", "cpu part")  # of x86, of Arm
# What makes these libraries take other instructions than the processor's best.
_SWITCHES = (
    "ONEDNN_MAX_CPU_ISA", "DNNL_MAX_CPU_ISA", "MKL_ENABLE_INSTRUCTIONS", "MKL_CBWR", "OPENBLAS_CORETYPE",
    "NPY_DISABLE_CPU_FEATURES", "OPENCV_CPU_DISABLE", "OPENCV_IPP",
)  # fmt: skip


def machine() -> dict[str, Any]:
    """This machine, as far as it can be told without loading PyTorch."""
    return {
        "system": platform.platform(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "processor": _processor_model(),
    }


def arithmetic(accelerator: str | None = None) -> str:
    """What decides how this process rounds, in one line; loads PyTorch.

    `accelerator`: what computes beside the processor.
    """
    import cv2
    import numpy as np
    import torch

    threads = torch.get_num_threads()
    parts = [
        *([accelerator] if accelerator else []),
        torch.backends.cpu.get_cpu_capability(),  # the instructions of PyTorch's own kernels: ATEN_CPU_CAPABILITY
        _processor_model(),
        platform.machine(),
        f"{threads} thread{'s' if threads > 1 else ''}",
        f"torch {torch.__version__}",
        f"numpy {np.__version__}",
        f"opencv {cv2.__version__}",
        *(f"{name}={os.environ[name]}" for name in _SWITCHES if name in os.environ),
    ]
    return ", ".join(parts)[:MAX_PROCESSOR]


def same_arithmetic(folder: Path | None, here: str, *, other_processor: bool) -> None:
    """Hold what this process computes on against what the states in its folder were computed on, and note it there.

    Raises:
        ConfigurationError: it is another, and `other_processor` does not allow that.
    """
    if folder is None:
        return
    file = folder / PROCESSOR
    before = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    if not any(folder.rglob("*.[01]")):  # nothing that it could go on from
        before = []
    if before and before[-1] != here:
        if not other_processor:
            raise ConfigurationError(f"state {folder}: {moved(before[-1], here)}")
        log.warning("state %s: begun on %s; going on on %s", folder, before[-1], here)
    if before[-1:] != [here]:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(file, "".join(f"{line}\n" for line in [*before, here]).encode())


def moved(before: str, here: str) -> str:
    """What to tell who goes on elsewhere."""
    return (
        f"begun on {before}; this is {here}: the end would be the one of neither, bit by bit; go on there, or here "
        "with --other-processor"
    )


class Others:
    """Tells once of each other arithmetic in the run that this process takes part in."""

    def __init__(self, here: str) -> None:
        self._known = {here}
        self._here = here

    def heard(self, presence: Presence) -> None:
        """Look at where somebody says that it is."""
        there = presence.processor
        if there is None or there in self._known:
            return
        self._known.add(there)
        who = f"robot {presence.agent}" if presence.agent else "the data center"
        told = "%s computes on %s, this process on %s: weights may be others than on one alone"
        log.warning(told, who, there, self._here)


@cache
def _processor_model() -> str:
    """The processor's own name, as the kernel tells it; virtual machines call several models by one."""
    try:
        told = _CPU_INFO.read_text(encoding="utf-8", errors="replace").split("\n\n", 1)[0]
    except OSError:
        told = ""
    pairs = (line.partition(":") for line in told.splitlines())
    fields = {key.strip().lower(): value.strip() for key, _, value in pairs}
    name = fields.get("model name") or platform.processor() or "processor without a name"
    numbers = [f"{key} {fields[key]}" for key in _NUMBERS if key in fields]
    return " ".join([name, *numbers])


if __name__ == "__main__":  # for who does not want to load PyTorch: `fleet.deploy` asks so
    from jouleswarm.common.process import use_one_thread

    use_one_thread()
    print(arithmetic())
