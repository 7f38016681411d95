"""What Flower's own environment finds, for `test_messages.py`: printed as JSON. Arguments: a folder."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from flwr.app import ArrayRecord, ConfigRecord, Context, Error, Message, MetricRecord, RecordDict
from flwr.common.serde import message_to_proto
from flwr.serverapp.strategy import DifferentialPrivacyServerSideFixedClipping, FedAvg
from flwr.supercore.task_identity import TaskIdentity

import jouleswarm.flower
from jouleswarm.common.errors import JouleSwarmError
from jouleswarm.flower import gradients, metered
from jouleswarm.flower.client import MeterMod
from jouleswarm.flower.sizes import size_of

TaskIdentity.run_id, TaskIdentity.node_id, TaskIdentity.task_id = 7, 1, 5  # type: ignore[misc]
PARTITIONS = {11: {"partition-id": 0}, 22: {}}
HOSTILE = ConfigRecord({"partition": "../x", "seconds": -1.0, "cpu_s": 0.0, "gradients": 0, "how": [], "joules": []})


def message(*shapes: tuple[int, ...], dtype: Any = np.float32, node: int = 11) -> Message:
    arrays = ArrayRecord([np.zeros(shape, dtype) for shape in shapes])
    return Message(RecordDict({"arrays": arrays, "config": ConfigRecord({"server-round": 2})}), node, "train")


def app(asked: Message, context: Context) -> Message:
    gradients(3)
    gradients()
    return Message(RecordDict({"metrics": MetricRecord({"num-examples": 1})}), reply_to=asked)


def answer(asked: Message) -> Message | None:
    """By node: measured, measured without a number of its own, an error, a record that is not ours, none."""
    node = asked.metadata.dst_node_id
    if node == 33:
        return Message(Error(1, "no data"), reply_to=asked)
    if node == 44:
        return Message(RecordDict({"jouleswarm": HOSTILE}), reply_to=asked)
    return MeterMod()(asked, Context(7, node, PARTITIONS[node], RecordDict(), {}), app) if node != 55 else None


class Grid:
    """Answers at once."""

    def __init__(self, number: int) -> None:
        self.run = SimpleNamespace(run_id=number)
        self.sizes: dict[str, int] = {}

    def get_node_ids(self) -> list[int]:
        return [11, 22]

    def push_messages(self, messages: Iterable[Message]) -> list[str]:
        self.pushed = list(messages)
        for each in self.pushed:
            each.metadata.__dict__["_message_id"] = f"{each.metadata.dst_node_id:064}"
            self._note("downlink", each.metadata.dst_node_id, each)
        return [each.metadata.message_id for each in self.pushed]

    def pull_messages(self, message_ids: Iterable[str]) -> list[Message]:
        replies = [reply for each in self.pushed if (reply := answer(each))]
        for each in replies:
            held = each.content.pop("jouleswarm") if each.has_content() else None
            self._note("uplink", each.metadata.src_node_id, each)
            if held is not None:
                each.content["jouleswarm"] = held
        return replies

    def send_and_receive(self, messages: Iterable[Message], *, timeout: float | None = None) -> list[Message]:
        return self.pull_messages(self.push_messages(messages))

    def _note(self, link: str, node: int, each: Message) -> None:
        self.sizes[f"{link} {node}"] = len(message_to_proto(each).SerializeToString())


def refused(call: Any) -> str:
    try:
        call()
    except JouleSwarmError as error:
        return f"{type(error).__name__}: {error}"
    return ""


def sizes() -> list[tuple[int, int, int]]:
    """Of messages around the sizes at which a length has one more byte: as ours says, as Flower serialises, arrays'."""
    lengths = [0, 1, *range(2**14 - 400, 2**14 + 10), *range(2**21 - 400, 2**21 + 10, 6)]
    every = [message((length,), dtype=np.uint8) for length in lengths]
    every += [message(), message((3, 4), (), (2, 0)), message((2, 3), dtype=np.float64)]
    return [(*size_of(each), len(message_to_proto(each).SerializeToString())) for each in every]


def main(folder: Path) -> dict[str, Any]:
    grid, found = Grid(42), dict[str, Any](sizes=sizes())
    over = metered(grid, out=folder, arm="mine")
    replies = over.send_and_receive([message((5, 2), node=node) for node in (11, 22, 33, 44, 55)], timeout=1)
    found["records_left"] = sum("jouleswarm" in each.content for each in replies if each.has_content())
    found |= {"replies": len(replies), "nodes": over.get_node_ids(), "serialised": grid.sizes}
    split = metered(Grid(43), out=folder)
    split.pull_messages(split.push_messages([message((5, 2))]))
    split.flush()
    full = metered(Grid(44), out=folder)
    (folder / "flower-44" / "counts.csv").unlink()
    (folder / "flower-44" / "counts.csv").mkdir()
    found["replies_when_full"] = len(full.send_and_receive([message((5, 2))]))
    (folder / "flower-44" / "counts.csv").rmdir()
    full.flush()
    arrays = ArrayRecord([np.zeros((5, 2), np.float32)])
    inner = metered(FedAvg(fraction_evaluate=0.5), out=folder)
    private = DifferentialPrivacyServerSideFixedClipping(inner, 1.0, 1.0, 2)
    found["fraction"] = inner.fraction_evaluate
    found["refused"] = [
        refused(lambda: private.start(Grid(45), arrays, num_rounds=1)),
        refused(lambda: metered(5)),
        refused(lambda: metered(Grid(46), out="/proc/none")),
        refused(lambda: gradients(-1)),
    ]
    gradients(5)  # no meter here: nothing
    return found | {"loaded": sorted({name.split(".")[0] for name in sys.modules}), "names": jouleswarm.flower.__all__}


print(json.dumps(main(Path(sys.argv[1]))))
