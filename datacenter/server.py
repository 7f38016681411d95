"""The data center process, to be read from top to bottom: for each method what it asks of a data center."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

from common import topics
from common.bus import Bus
from common.methods import EXACT_METHODS, Method
from common.payloads import ModelHeader, encode_model
from common.reports import leave, publish_row
from common.runlog import RoundRow
from common.scenario import Scenario
from common.streams import WeightsEncoder
from datacenter.beta import measure_beta
from datacenter.checkpoint import Checkpoint, RoundMotions
from datacenter.collector import Collector
from datacenter.metalearner import Gradients, MetaLearner
from datacenter.serving import SERVICES, serve


def run_datacenter(scenario: Scenario, run: str, bus: Bus, state: Path | None = None) -> None:
    """Do the data center's part of every method, in the robots' order; meta-learning resumes from `state`."""
    checkpoints = {method: Checkpoint(state / method if state else None) for method in scenario.meta_methods}
    for method in scenario.methods:
        if method in checkpoints and not checkpoints[method].is_finished:
            meta_train(scenario, method, run, bus, checkpoints[method])
        elif method in SERVICES:
            serve(scenario, method, run, bus)
    for checkpoint in checkpoints.values():
        checkpoint.clear()
    if state is not None:
        with contextlib.suppress(OSError):  # somebody else's files may be in it
            state.rmdir()
    leave(bus, run, [], topics.presence(run, 0, 0))


def meta_train(scenario: Scenario, method: Method, run: str, bus: Bus, checkpoint: Checkpoint) -> None:
    """Collect experience and meta-train for t0 rounds, send meta-models down, stay until all robots have them."""
    settings, arms = scenario.meta, {arm.t0: arm for arm in scenario.arms if arm.method == method}
    learner, collector = MetaLearner(scenario, method), Collector(bus, scenario, run, method)
    done, models = checkpoint.restore(learner), checkpoint.models()
    collector.join(done)
    beta = None
    if scenario.energy.beta == "measured":
        beta = measure_beta(scenario, method).beta_time if method in EXACT_METHODS else 1.0
    for round_ in range(done + 1, settings.t0 + 1):
        # One round ahead: robots move while the data center learns.
        collector.announce_wanted(round_, min(round_ + 1, settings.t0))
        motions = collector.collect(round_)
        begun = time.monotonic()
        for task, robots in motions.items():
            for each in robots:
                learner.remember(task, each)
        gradients = learner.learn(round_)
        if round_ in {*settings.snapshots, *arms}:
            weights, header = learner.weights(), ModelHeader(task=0, agent=0, round=round_)
            bus.publish(topics.snapshot(run, method, round_), encode_model(weights, header))
            if round_ in arms:
                # Robots have nothing yet that it could build on: an encoder of its own for each.
                models[round_] = WeightsEncoder(scenario.federation.weights_codec).payload(weights, header)
                checkpoint.keep_model(round_, models[round_])
        checkpoint.save(round_, learner, motions)
        _report(bus, run, method, round_, gradients, motions, collector.refused, time.monotonic() - begun, beta)

    for t0, arm in arms.items():
        bus.publish(topics.meta_model(run, arm.name), models[t0], qos=scenario.bus.qos)
    collector.announce_wanted(settings.t0 + 1, settings.t0 + 1)
    by_name = {arm.name: models[arm.t0] for arm in arms.values()}
    ready = 2 * scenario.arm_names.index(method) + 1
    while (asked := collector.robots_that_missed_a_model(ready)) is not None:
        for name, agent in asked:
            bus.publish(topics.meta_model(run, name, agent), by_name[name], qos=scenario.bus.qos)
    checkpoint.finish()
    collector.leave()
    bus.publish(topics.meta_round(run, method), b"", retain=True)


def _report(
    bus: Bus,
    run: str,
    method: str,
    round_: int,
    gradients: dict[int, Gradients],
    motions: RoundMotions,
    refused: int,
    seconds: float,
    beta: float | None,
) -> None:
    for task, counts in gradients.items():
        row = RoundRow(
            phase="maml",
            arm=method,
            task=task,
            agent=0,
            round=round_,
            gradients=counts.support + counts.query,
            gradients_support=counts.support,
            gradients_query=counts.query,
            beta=beta,
            experience_bytes=sum(motion.payload_bytes for robot in motions[task] for motion in robot),
            refused=refused,
            seconds=round(seconds / len(gradients), 4),
        )
        publish_row(bus, run, row)
