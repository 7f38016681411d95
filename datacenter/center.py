"""The data center process, to be read from top to bottom: for each method what it asks of a data center."""

from __future__ import annotations

import contextlib
import logging
import time
from functools import partial
from pathlib import Path

from jouleswarm.codecs.streams import WeightsEncoder
from jouleswarm.common.bus.agreement import Agreement
from jouleswarm.common.bus.bus import Bus, Message
from jouleswarm.common.bus.identity import Identity
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.bus.patience import Patience
from jouleswarm.common.bus.reporter import HANDED_IN, Reporter
from jouleswarm.common.disk.lock import LOCK
from jouleswarm.common.disk.state import NOTHING, Keep
from jouleswarm.common.host import PROCESSOR, arithmetic
from jouleswarm.common.scenario.arms import EXACT_METHODS, META_METHODS, Method
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import ModelHeader, Presence, decode_json
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.saved_models import encode_saved_model
from jouleswarm.datacenter.beta import measure_beta
from jouleswarm.datacenter.checkpoint import Checkpoint, owner_of
from jouleswarm.datacenter.collector import Collector
from jouleswarm.datacenter.experience import Motion
from jouleswarm.datacenter.metalearner import Gradients, MetaLearner
from jouleswarm.datacenter.serving import SERVICES, serve
from jouleswarm.learning.device import accelerator
from jouleswarm.learning.networks import use_of

log = logging.getLogger("jouleswarm.datacenter")


def run_datacenter(scenario: Scenario, run: str, bus: Bus, keep: Keep = NOTHING) -> None:
    """Do the data center's part of every method, in the robots' order; with a folder to `keep` go on from where one was
    killed.

    Raises:
        ConfigurationError: another process is this run's data center, or the run has another scenario.
        RunError: the folder holds another scenario's state, or lacks what the robots are further with.
        TrainingError: a gradient is not finite.
    """
    state = keep.folder
    patience = Patience(bus, run, scenario.federation.give_up_after_s)
    listener = Listener(bus, scenario.bus.resend_after_s, patience)
    reporter = Reporter(listener, run, state / "rounds.jsonl" if state else None)
    identity = Identity(listener, run, 0, 0, scenario.bus.keepalive_s, arithmetic(accelerator()))
    listener.handlers["presence"] = lambda message: hear_presence(message, listener, identity)
    identity.claim()
    agreement = Agreement(listener, scenario, run)
    agreement.settle()
    identity.announce(0)  # who would be a second one hears it at once
    checkpoints = {
        method: Checkpoint(state / method if state else None, owner_of(scenario, run, method), durable=keep.durable)
        for method in scenario.methods
        if method in (*META_METHODS, *SERVICES)
    }
    if checkpoints and all(checkpoint.is_finished for checkpoint in checkpoints.values()):
        log.warning("the data center is done with run %s: handing in again; to learn anew delete %s", run, state)
    for method, checkpoint in checkpoints.items():
        if not checkpoint.is_finished:
            work = meta_train if method in META_METHODS else serve
            work(scenario, method, run, listener, identity, reporter, checkpoint)
    done = Presence(agent=0, stage=2 * len(scenario.arms) + 1, state="done")
    stay = not keep.at_the_end and state is not None
    agreement.leave()
    reporter.hand_over([*identity.filters, *agreement.filters], identity.presence, done, stay=stay)
    if not keep.at_the_end:
        _forget(state, checkpoints)
    reporter.leave(identity.presence)


def hear_presence(message: Message, listener: Listener, identity: Identity) -> None:
    """Presence of the data center itself is its identity's; robots' are the open desk's."""
    own = bool(message.payload) and (presence := decode_json(message.payload, Presence)).agent == 0
    if own:
        identity.heard(presence)
    else:
        listener.otherwise(message)


def meta_train(
    scenario: Scenario,
    method: Method,
    run: str,
    listener: Listener,
    identity: Identity,
    reporter: Reporter,
    checkpoint: Checkpoint,
) -> None:
    """Collect experience and meta-train for t0 rounds, send meta-models down, stay until all robots have them."""
    bus, settings = listener.bus, scenario.meta
    arms = {arm.t0: arm for arm in scenario.arms if arm.method == method}
    learner = MetaLearner(scenario, method, checkpoint.folder, partial(bus.meter.tally, "maml", method))
    collector = Collector(listener, scenario, run, method)
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
            saved = encode_saved_model(weights, header, use_of(scenario), heads=learner.meta_model.tasks)
            reporter.deliver(topics.snapshot(run, method, round_), saved)
            if round_ in arms:
                # Robots have nothing yet that it could build on: an encoder of its own for each.
                models[round_] = WeightsEncoder(scenario.federation.weights_codec).payload(weights, header)
                checkpoint.keep_model(round_, models[round_])
        _report(reporter, method, round_, gradients, motions, collector.refused, time.monotonic() - begun, beta)
        checkpoint.save(round_, learner.state())

    for t0, arm in arms.items():
        bus.publish(topics.meta_model(run, arm.name), models[t0], qos=scenario.bus.qos)
    collector.announce_wanted(settings.t0 + 1, settings.t0 + 1)
    by_name = {arm.name: models[arm.t0] for arm in arms.values()}
    while (asked := collector.robots_that_missed_a_model()) is not None:
        for name, agent in asked:
            bus.publish(topics.meta_model(run, name, agent), by_name[name], qos=scenario.bus.qos)
    checkpoint.finish()
    collector.leave()
    bus.publish(topics.meta_round(run, method), b"", retain=True)


def _forget(state: Path | None, checkpoints: dict[Method, Checkpoint]) -> None:
    """The run is over: leave no trace."""
    for checkpoint in checkpoints.values():
        checkpoint.clear()
    if state is not None:
        own = ("rounds.jsonl", PROCESSOR, LOCK, "counters*", f"*{HANDED_IN}")
        for path in (path for each in own for path in state.glob(each)):
            path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # somebody else's files may be in it
            state.rmdir()


def _report(
    reporter: Reporter,
    method: str,
    round_: int,
    gradients: dict[int, Gradients],
    motions: dict[int, list[list[Motion]]],
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
        reporter.row(row)
