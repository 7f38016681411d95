"""The data center process, to be read from top to bottom: collect -> meta-train -> publish."""

from __future__ import annotations

import time
from pathlib import Path

from common import topics
from common.bus import Bus
from common.payloads import ModelHeader, encode_model
from common.reports import leave, publish_row
from common.runlog import RoundRow
from common.scenario import Scenario
from datacenter.checkpoint import Checkpoint
from datacenter.collector import Collector
from datacenter.metalearner import Gradients, MetaLearner

ARM = "maml"


def run_datacenter(scenario: Scenario, run: str, bus: Bus, state: Path | None = None) -> None:
    """Collect experience and meta-train for t0 rounds, send the meta-model down, stay until all robots have it."""
    settings = scenario.meta
    learner, collector, checkpoint = MetaLearner(scenario), Collector(bus, scenario, run, ARM), Checkpoint(state)
    done = checkpoint.restore(learner)
    collector.join(done)
    for round_ in range(done + 1, settings.t0 + 1):
        # One round ahead: robots move while the data center learns.
        collector.announce_wanted(round_, min(round_ + 1, settings.t0))
        motions = collector.collect(round_)
        begun = time.monotonic()
        for task, robots in motions.items():
            for each in robots:
                learner.remember(task, each)
        gradients = learner.learn(round_)
        checkpoint.save(round_, learner, motions)
        if round_ in settings.snapshots or round_ == settings.t0:
            bus.publish(topics.snapshot(run, ARM, round_), _payload(learner, round_))
        _report(bus, run, round_, gradients, collector.refused, time.monotonic() - begun)

    bus.publish(topics.meta_model(run, ARM), _payload(learner, settings.t0), qos=scenario.bus.qos)
    collector.announce_wanted(settings.t0 + 1, settings.t0 + 1)
    ready = 2 * scenario.arms.index(ARM) + 1
    while (asked := collector.robots_that_missed_the_model(ready)) is not None:
        for agent in asked:
            topic = topics.meta_model(run, ARM, agent)
            bus.publish(topic, _payload(learner, settings.t0), qos=scenario.bus.qos)
    checkpoint.clear()
    leave(bus, run, collector.subscriptions, topics.meta_round(run, ARM))


def _payload(learner: MetaLearner, round_: int) -> bytes:
    return encode_model(learner.weights(), ModelHeader(task=0, agent=0, round=round_))


def _report(bus: Bus, run: str, round_: int, gradients: dict[int, Gradients], refused: int, seconds: float) -> None:
    for task, counts in gradients.items():
        row = RoundRow(
            phase="maml",
            arm=ARM,
            task=task,
            agent=0,
            round=round_,
            gradients=counts.support + counts.query,
            gradients_support=counts.support,
            gradients_query=counts.query,
            refused=refused,
            seconds=round(seconds / len(gradients), 4),
        )
        publish_row(bus, run, row)
