"""A made-up run, small enough that every figure of its bill can be worked out by hand.

2 tasks x 2 robots (task 1: robots 1, 2; task 2: robots 3, 4), t0 = 3 MAML rounds. Experience: 20 messages of 1000 B
(1100 B as packets) a round from robots 1 and 3. Weights: 5000 B (5040 B as packets). MAML arm: task 1 learned after
4 rounds, task 2 after 6. Other arm: task 1 after 10, task 2 not learned in 20.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.meter.meter import Meter, MeterRow
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.runs.directory import RunDirectory

RUN = "made-up"
T0 = 3
ROUNDS = {"maml": {1: 4, 2: 6}, "fl": {1: 10, 2: 20}}
ROBOTS = {1: (1, 2), 2: (3, 4)}
SCENARIO = {
    "name": "made-up",
    "seed": 7,
    "world": {"rows": 3, "cols": 2},
    "federation": {"max_rounds": 20},
    "meta": {"t0": T0, "training_tasks": [1, 2]},
    "tasks": [{"id": 1, "map": "E . \n * . \n X ."}, {"id": 2, "map": "E . \n * * \n . X"}],
}


@dataclass
class Facts:
    scenario: Scenario
    rows: list[RoundRow]
    meter_rows: list[MeterRow]


class _Traffic:
    """Books each message at the broker and at its clients."""

    def __init__(self) -> None:
        self.broker, self.client = Meter("broker"), Meter("client")

    def send(self, sender: str, topic: str, receivers: list[str], payload: int, packet: int) -> None:
        self.client.count(sender, topic, "out", payload, packet)
        self.broker.count(sender, topic, "in", payload, packet)
        for receiver in receivers:
            self.broker.count(receiver, topic, "out", payload, packet)
            self.client.count(receiver, topic, "in", payload, packet)


def _round_rows() -> list[RoundRow]:
    rows = []
    for round_ in range(1, T0 + 1):
        for task, (collector, _) in ROBOTS.items():
            rows.append(
                RoundRow(
                    phase="maml", arm="maml", task=task, agent=0, round=round_, seconds=0.4,
                    gradients=20, gradients_support=10, gradients_query=10,
                )
            )  # fmt: skip
            rows.append(RoundRow(phase="maml", arm="maml", task=task, agent=collector, round=round_, seconds=0.5))
    for arm, rounds in ROUNDS.items():
        for task, last in rounds.items():
            learned = (arm, task) != ("fl", 2)
            for round_ in range(1, last + 1):
                for place, agent in enumerate(ROBOTS[task]):
                    rows.append(
                        RoundRow(
                            phase="fl", arm=arm, task=task, agent=agent, round=round_, seconds=2.0,
                            reward=60.0 * round_ / last + place if learned else -20.0,
                            cluster_reward=55.0 * round_ / last if learned else -20.0,
                            rmse_m=1.0 + 0.5 * place, gradients=20,
                            learned=learned if round_ == last else None,
                        )
                    )  # fmt: skip
    return rows


def _meter_rows() -> list[MeterRow]:
    bus = _Traffic()
    for task, (collector, _) in ROBOTS.items():
        for _motion in range(T0 * 20):
            topic = topics.experience(RUN, "maml", task, collector)
            bus.send(f"agent-{collector}", topic, ["datacenter"], 1000, 1100)
    robots = [f"agent-{agent}" for pair in ROBOTS.values() for agent in pair]
    bus.send("datacenter", topics.meta_model(RUN, "maml"), robots, 5000, 5050)
    for arm, rounds in ROUNDS.items():
        for task, last in rounds.items():
            for sender, neighbour in (ROBOTS[task], ROBOTS[task][::-1]):
                for _round in range(last):
                    topic = topics.weights(RUN, arm, task, sender)
                    bus.send(f"agent-{sender}", topic, [f"agent-{neighbour}", "mosquitto_sub"], 5000, 5040)
    bus.send("datacenter", topics.meta_round(RUN, "maml"), robots, 100, 150)
    bus.send("agent-1", topics.telemetry(RUN, "maml", "agent-1"), ["recorder", "mosquitto_sub"], 300, 350)
    bus.send("agent-1", topics.presence(RUN, 1, 1), ["agent-2", "recorder"], 40, 90)
    return bus.broker.rows() + bus.client.rows()


@pytest.fixture
def facts() -> Facts:
    return Facts(scenario_from(SCENARIO, "made-up"), _round_rows(), _meter_rows())


@pytest.fixture
def write_run(tmp_path: Path, facts: Facts) -> Callable[..., Path]:
    """Writes the made-up run as a run directory; an interrupted one has no meter rows and no summary."""

    def write(summary: dict[str, Any] | None = None, **scenario: Any) -> Path:
        resolved = scenario_from({**SCENARIO, **scenario}, "made-up")
        directory = RunDirectory(tmp_path / "run")
        directory.manifest(
            {
                "schema": 2,
                "run": RUN,
                "scenario": resolved.model_dump(mode="json"),
                "seed": resolved.seed,
                "versions": {"jouleswarm": "0.1.0"},
                "host": {"cpus": 2},
                "started": "2024-05-01T12:00:00+00:00",
                "broker": {"embedded": True, "url": "mqtt://localhost:1883"},
            }
        )
        for row in facts.rows:
            directory.round(row)
        for second, total in enumerate((0, 60_000, 120_000)):
            directory.progress({"time_s": float(second), "bytes": {"uplink": total, "sidelink": 0, "control": 9}})
        if summary is not None:
            directory.meter(facts.meter_rows)
            directory.summary(summary)
        return directory.path

    return write
