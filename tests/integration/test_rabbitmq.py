"""A run over a cluster of RabbitMQ nodes, where `deploy/rabbitmq.sh start` has made one: starting one takes minutes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

URL = os.environ.get("JOULESWARM_RABBITMQ")
TOY = str(Path(__file__).parents[2] / "scenarios" / "toy.toml")

pytestmark = [
    pytest.mark.external,
    pytest.mark.skipif(URL is None, reason="JOULESWARM_RABBITMQ names no cluster: deploy/rabbitmq.sh start"),
]


def test_a_cluster_carries_a_run_with_the_same_rounds_weights_and_bytes(
    start: Any, read_run: Any, small: tuple[str, ...], small_run: Any, tmp_path: Path
) -> None:
    run = start.jouleswarm(
        "run", TOY, "--broker", str(URL), "--run-id", f"rabbit-{os.getpid()}", "--out", str(tmp_path), "--no-figures",
        *(part for each in small for part in ("--set", each)),
    )  # fmt: skip
    assert run.ends() == 0, run.printed
    done = read_run(next(tmp_path.glob("rabbit-*")))
    assert (done.figures, done.weights) == (small_run.figures, small_run.weights)
    sent: dict[str, int] = {}
    received: dict[str, set[int]] = {}
    for row in done.lines("meter.jsonl"):
        if row["link"] in ("uplink", "downlink", "sidelink"):
            if row["direction"] == "out":
                sent[row["topic"]] = row["payload_bytes"]
            elif row["direction"] == "in":
                received.setdefault(row["topic"], set()).add(row["payload_bytes"])
    assert received == {topic: {payload_bytes} for topic, payload_bytes in sent.items()}
