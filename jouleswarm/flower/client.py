"""The client's part: what its app takes, measured around it and told to the server with the reply."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from typing import Any

from flwr.app import ConfigRecord, Context, Message

from jouleswarm.common.errors import ConfigurationError, PayloadError
from jouleswarm.common.meter.cells import Cell, Key
from jouleswarm.common.meter.counts_file import check_word
from jouleswarm.common.meter.joule_meter import JouleMeter
from jouleswarm.common.meter.power import NVML, Rated, gpu, processor

RECORD = "jouleswarm"
"""Key of the record in a reply; the server takes it out before its strategy sees it."""
_APP = "app"
_N = 1_000_000_000
_gradients: ContextVar[list[int] | None] = ContextVar("gradients", default=None)

Told = tuple[str, float, str]
"""(what, how much, how it was had)."""


def gradients(count: int = 1) -> None:
    """Inside a ClientApp: batch gradients have been computed, which the bill prices. Where no meter is: nothing.

    Raises:
        ConfigurationError: fewer than none.
    """
    if count < 0:
        raise ConfigurationError(f"gradients: {count}, expected 0 or more")
    if (held := _gradients.get()) is not None:
        held.append(count)


class MeterMod:
    """A mod that measures what the app inside takes; first in `mods`, it measures other mods too."""

    def __init__(self, rated: Rated | None = None, gpu_uuid: str | None = None) -> None:
        """
        Args:
            rated: of the processor, where its counter cannot be read: joules are then estimated by CPU time.
            gpu_uuid: of the GPU whose counter is read too, as PyTorch tells it.
        """
        self._rated, self._gpu_uuid = rated or Rated(), gpu_uuid

    def __call__(self, message: Message, context: Context, call_next: Callable[[Message, Context], Message]) -> Message:
        """The app's reply, and with it a record of what it took."""
        cells: dict[Key, Cell] = {}
        meter = JouleMeter(lambda key: cells.setdefault(key, Cell()), processor(self._rated), gpu(self._gpu_uuid))
        counted: list[int] = []
        token = _gradients.set(counted)
        meter.enter("", "", _APP)
        try:
            reply = call_next(message, context)
        finally:
            _gradients.reset(token)
        meter.settle()
        if reply.has_content():
            partition = str(context.node_config.get("partition-id", ""))
            told = {"partition": partition, "gradients": sum(counted)} | _measured(cells)
            reply.content[RECORD] = ConfigRecord(told)
        return reply


meter_mod = MeterMod()


def _measured(cells: Mapping[Key, Cell]) -> dict[str, Any]:
    places = {tuple(where.split("/", 3)): cell for (_, where, _), cell in cells.items()}  # phase, arm, activity, how
    found = {how: cell for (*_, activity, how), cell in places.items() if activity == _APP}
    own = next(cell for how, cell in found.items() if how != NVML)
    joules = [cell.payload_bytes / _N for cell in found.values()]
    return {"seconds": own.messages / _N, "cpu_s": own.packet_bytes / _N, "how": [*found], "joules": joules}


def read_record(record: Mapping[str, Any]) -> tuple[str, list[Told]]:
    """The client's name, "" where it has none, and what it took.

    Raises:
        PayloadError: it is not what a mod of ours tells.
    """
    try:
        partition, hows, joules = record["partition"], record["how"], record["joules"]
        told = [(what, float(record[what]), "") for what in ("seconds", "cpu_s", "gradients")]
        told += [("joules", float(drawn), how) for how, drawn in zip(hows, joules, strict=True)]
        for how in hows:
            check_word(how)
        if partition and not (partition.isdecimal() and len(partition) <= 6):
            raise ValueError(f"partition-id {partition!r:.40}")
        if not all(math.isfinite(value) and value >= 0 for _, value, _ in told):
            raise ValueError(f"{told}")
    except (KeyError, TypeError, ValueError, AttributeError, ConfigurationError) as error:
        raise PayloadError(f"record {RECORD!r}: {error!r:.200}, expected what meter_mod tells") from error
    return partition and f"client-{int(partition)}", [each for each in told if each[1]]
