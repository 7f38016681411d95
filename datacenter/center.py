"""The data center process, to be read from top to bottom: for each method what it asks of a data center."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from jouleswarm.codecs.codec import codec_of
from jouleswarm.codecs.streams import WeightsEncoder
from jouleswarm.common.bus.agreement import Agreement
from jouleswarm.common.bus.bus import Bus, Message
from jouleswarm.common.bus.identity import Identity
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.bus.patience import Patience
from jouleswarm.common.bus.reporter import Reporter
from jouleswarm.common.disk.checkpoint import owner_of
from jouleswarm.common.disk.state import NOTHING, Keep, State, Together
from jouleswarm.common.errors import TrainingError
from jouleswarm.common.host import arithmetic
from jouleswarm.common.meter.joules import Activity
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import ModelHeader, Presence, decode_json
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.saved_models import encode_saved_model
from jouleswarm.common.wire.types import RowPhase, Weights
from jouleswarm.datacenter.checkpoint import Checkpoint, forget
from jouleswarm.datacenter.cluster_rounds import ClusterDesk
from jouleswarm.datacenter.collector import Collector
from jouleswarm.datacenter.experience import Motion, TrainingExperience
from jouleswarm.datacenter.services import service_of
from jouleswarm.learning.device import accelerator, accelerator_uuid
from jouleswarm.learning.heads import head_of, meta_shapes
from jouleswarm.learning.networks import build_qnetwork, shapes_of, use_of
from jouleswarm.methods.contract import unfit
from jouleswarm.methods.method import Gradients, Method, Stage

log = logging.getLogger("jouleswarm.datacenter")


def run_datacenter(scenario: Scenario, run: str, bus: Bus, keep: Keep = NOTHING) -> None:
    """Do the data center's part of every method, in the robots' order; with a folder to `keep` go on from where one was
    killed.

    Raises:
        ConfigurationError: another process is this run's data center, or the run has another scenario.
        RunError: the folder holds another scenario's state, or lacks what the robots are further with.
        TrainingError: a gradient is not finite.
    """
    bus.meter.measure(scenario.measure, accelerator_uuid())
    center, state = DataCenter(scenario, run, bus, keep.folder), keep.folder
    center.identity.claim()
    agreement = Agreement(center.listener, scenario, run)
    agreement.settle()
    center.identity.announce(0)  # who would be a second one hears it at once
    stages = {method: center.checkpoint(RowPhase.ML, method, method, keep) for method in scenario.meta_methods}
    served = [arm for arm in scenario.arms if scenario.method(arm.method).partners == "datacenter"]
    services = {arm: center.checkpoint("fl", arm.name, f"{arm.name}{SERVED if arm.t0 else ''}", keep) for arm in served}
    checkpoints = [*stages.values(), *services.values()]
    if checkpoints and all(checkpoint.is_finished for checkpoint in checkpoints):
        log.warning("the data center is done with run %s: handing in again; to learn anew delete %s", run, state)
    for method in scenario.method_names:
        if method in stages and not stages[method].is_finished:
            center.train(method, stages[method])
        for arm in (arm for arm in served if arm.method == method and not services[arm].is_finished):
            center.serve(arm, services[arm])
    done = Presence(agent=0, stage=2 * len(scenario.arms) + 1, state="done")
    stay = not keep.at_the_end and state is not None
    agreement.leave()
    filters = [*center.identity.filters, *agreement.filters]
    center.reporter.hand_over(filters, center.identity.presence, done, stay=stay)
    if not keep.at_the_end:
        forget(state, checkpoints)
    center.reporter.leave(center.identity.presence)


SERVED = ".served"
"""Ending of the folder of an arm's service, where its stage has one too."""


class DataCenter:
    """What a data center's work needs, whichever method's it is."""

    def __init__(self, scenario: Scenario, run: str, bus: Bus, state: Path | None) -> None:
        self.scenario, self.run, self.bus, self._state = scenario, run, bus, state
        patience = Patience(bus, run, scenario.federation.give_up_after_s)
        self.listener = Listener(bus, scenario.bus.resend_after_s, patience)
        self.reporter = Reporter(self.listener, run, state / "rounds.jsonl" if state else None)
        processor = arithmetic(accelerator())
        self.identity = Identity(self.listener, run, 0, 0, scenario.bus.keepalive_s, processor)
        self.listener.handlers["presence"] = lambda message: hear_presence(message, self.listener, self.identity)

    def checkpoint(self, phase: str, arm: str, name: str, keep: Keep) -> Checkpoint:
        """Of a method's stage, or of an arm's service."""
        folder, limits = self._state / name if self._state else None, self.scenario.federation
        until = f"{limits.max_rounds} rounds, {limits.target_reward}" if keep.ends and phase == RowPhase.FL else None
        owner = owner_of(self.scenario, self.run, arm)
        return Checkpoint(folder, owner, (phase, arm), durable=keep.durable, until=until)

    def train(self, method: str, checkpoint: Checkpoint) -> None:
        """Collect experience and train for t0 rounds, send models down, stay until all robots have them."""
        scenario, settings, energy = self.scenario, self.scenario.meta, self.bus.meter.energy
        energy.enter(RowPhase.ML, method, "start")
        arms = {arm.t0: arm for arm in scenario.arms if arm.method == method}
        make = scenario.method(method)
        stage, experience = make.stage(scenario), TrainingExperience(scenario, checkpoint.folder)
        stage.tally = partial(self.bus.meter.tally, RowPhase.ML, method)
        collector = Collector(self.listener, scenario, self.run, method)
        training = Together({"stage": stage, "experience": Together(experience.kept)})
        done, models = checkpoint.restore(training), checkpoint.models()
        collector.join(done)
        beta = stage.beta() if scenario.energy.beta == "measured" else None
        energy.enter(RowPhase.ML, method)
        for round_ in range(done + 1, settings.t0 + 1):
            # One round ahead: robots move while the data center learns.
            collector.announce_wanted(round_, min(round_ + 1, settings.t0))
            motions = collector.collect(round_)
            begun = time.monotonic()
            for each in (each for robots in motions.values() for each in robots):
                experience.remember(each)
            with energy.during("learning"):
                gradients = stage.learn(round_, experience.replays)
            if round_ in {*settings.snapshots, *arms}:
                weights, header = self._model_of(make, stage), ModelHeader(task=0, agent=0, round=round_)
                saved = encode_saved_model(weights, header, use_of(scenario), heads=make.heads(scenario))
                self.reporter.deliver(topics.snapshot(self.run, method, round_), saved)
                if round_ in arms:
                    # Robots have nothing yet that it could build on: an encoder of its own for each.
                    models[round_] = WeightsEncoder(codec_of(scenario)).payload(weights, header)
                    checkpoint.keep_model(round_, models[round_])
            self._report(method, round_, gradients, motions, collector.refused, time.monotonic() - begun, beta)
            checkpoint.save(round_, training)

        for t0, arm in arms.items():
            self.bus.publish(topics.meta_model(self.run, arm.name), models[t0], qos=scenario.bus.qos)
        collector.announce_wanted(settings.t0 + 1, settings.t0 + 1)
        by_name = {arm.name: models[arm.t0] for arm in arms.values()}
        while (asked := collector.robots_that_missed_a_model()) is not None:
            for name, agent in asked:
                self.bus.publish(topics.meta_model(self.run, name, agent), by_name[name], qos=scenario.bus.qos)
        checkpoint.finish()
        collector.leave()
        self.bus.publish(topics.meta_round(self.run, method), b"", retain=True)

    def _model_of(self, method: Method, stage: Stage) -> Weights:
        network = build_qnetwork(self.scenario)
        shapes = meta_shapes(shapes_of(network), head_of(network), method.heads(self.scenario))
        model = stage.weights()
        if wrong := unfit(model, shapes):
            raise TrainingError(f"method {method.name}: its stage's weights: {wrong}")
        return {name: model[name] for name in shapes}

    def serve(self, arm: Arm, checkpoint: Checkpoint) -> None:
        """Serve all clusters, whichever round of whichever is complete first, until every robot is done."""
        scenario, energy = self.scenario, self.bus.meter.energy
        activity: Activity = "learning" if scenario.method(arm.method).sends == "experience" else "communication"
        energy.enter(RowPhase.FL, arm.name, "start")
        service = service_of(scenario, arm, checkpoint.folder, partial(self.bus.meter.tally, RowPhase.FL, arm.name))
        opened = 2 * scenario.arms.index(arm) + 1
        desk = ClusterDesk(self.listener, scenario, self.run, arm.name, service, done=opened + 1)
        for task in scenario.clusters:
            if found := checkpoint.load(f"task-{task}"):
                found[1].into(service.kept(task))
                desk.load_state(task, found[1].part("desk"), may_have_missed=not checkpoint.was_finished)
        desk.listen()
        # Robots wait for this: what they sent up before there was anybody to hear it would be lost.
        self.identity.announce(opened)
        energy.enter(RowPhase.FL, arm.name)
        while (turn := desk.next_round()) is not None:
            begun = time.monotonic()
            with energy.during(activity):
                payload, gradients = service.model(turn)
            desk.answer(turn, payload)
            if gradients:
                row = RoundRow(
                    phase=RowPhase.FL,
                    arm=arm.name,
                    task=turn.task,
                    agent=0,
                    round=turn.round,
                    gradients=gradients,
                    refused=desk.refused,
                    seconds=round(time.monotonic() - begun, 4),
                )
                self.reporter.row(row)
            if checkpoint.folder is not None:
                state = State.of({**service.kept(turn.task), "desk": desk.state(turn.task)})
                checkpoint.save(turn.round, state, f"task-{turn.task}")
            # Robots forget a round's experience when they have its model.
            desk.send(turn.task)
        checkpoint.finish()
        desk.leave()

    def _report(
        self,
        method: str,
        round_: int,
        gradients: Mapping[int, Gradients],
        motions: dict[int, list[list[Motion]]],
        refused: int,
        seconds: float,
        beta: float | None,
    ) -> None:
        for task, counts in gradients.items():
            row = RoundRow(
                phase=RowPhase.ML,
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
            self.reporter.row(row)


def hear_presence(message: Message, listener: Listener, identity: Identity) -> None:
    """Presence of the data center itself is its identity's; robots' are the open desk's."""
    own = bool(message.payload) and (presence := decode_json(message.payload, Presence)).agent == 0
    if own:
        identity.heard(presence)
    else:
        listener.otherwise(message)
