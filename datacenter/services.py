"""What the data center does with a cluster's round by any method: read it, have it served, answer in the codec."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jouleswarm.codecs.codec import codec_of
from jouleswarm.codecs.models import read_model
from jouleswarm.codecs.observations import experience_codec_of
from jouleswarm.codecs.streams import WeightsDecoder, WeightsEncoder
from jouleswarm.common.disk.state import KeptTensors, Stateful
from jouleswarm.common.errors import PayloadError, TrainingError
from jouleswarm.common.meter.work import TallyOf, nobody
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.seeding import stream
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.types import Payload, Shapes, Tensors, Weights
from jouleswarm.datacenter.cluster_rounds import Service, Turn
from jouleswarm.datacenter.experience import Motion, Walks, read_motion
from jouleswarm.learning.learner import Learner
from jouleswarm.learning.networks import build_qnetwork, shapes_of
from jouleswarm.learning.start import start_weights
from jouleswarm.methods.contract import read_only, unfit
from jouleswarm.methods.ledger import RewardLedger
from jouleswarm.methods.method import ClusterRound, Method, Update

Arrived = tuple[Weights, ModelHeader]


def service_of(scenario: Scenario, arm: Arm, folder: Path | None = None, tally: TallyOf = nobody) -> Service[Any]:
    """What serves an arm whose robots meet the data center.

    `folder`: for the frames of replay memories; `tally`: counts batch gradients as they are computed.
    """
    if scenario.method(arm.method).sends == "experience":
        return ExperienceService(scenario, arm, folder, tally)
    return WeightsService(scenario, arm)


class WeightsService:
    """Robots' weights in, the cluster's model out; each robot is told what all others were rewarded.

    With a lossy codec it keeps what its message could not tell for the next model (error feedback, as in Sattler
    et al. 2019); robots' messages build on the model that they have all been sent.
    """

    word = "weights"

    def __init__(self, scenario: Scenario, arm: Arm) -> None:
        self._clusters, self._scenario = scenario.clusters, scenario
        self._shapes: Shapes = shapes_of(build_qnetwork(scenario))
        self._codec = codec_of(scenario)
        window = scenario.federation.reward_window
        self._methods: dict[int, Method] = {task: scenario.method(arm.method) for task in scenario.clusters}
        self._ledgers = {task: RewardLedger(cluster, 1, window) for task, cluster in scenario.clusters.items()}
        self._encoders = {task: WeightsEncoder(self._codec) for task in scenario.clusters}
        self._decoders = {agent: WeightsDecoder(self._codec, self._shapes) for agent in scenario.agents}
        self._untold = {task: KeptTensors() for task in scenario.clusters}

    def messages(self, agent: int) -> int:
        return 1

    def read(self, payload: Payload, task: int, agent: int) -> tuple[int, int, tuple[Tensors, ModelHeader]]:
        """A robot's weights of a round, not decoded yet: that is done in the order of rounds.

        Raises:
            PayloadError: not this robot's weights, its reward and its number of samples.
        """
        tensors, header = read_model(payload, self._shapes, self._codec)
        if (header.task, header.agent) != (task, agent) or agent not in header.rewards or header.samples < 1:
            raise PayloadError(
                f"model of robot {header.agent}, task {header.task}, samples {header.samples}, rewards "
                f"{header.rewards}; expected robot {agent}, task {task}, its reward and samples"
            )
        return header.round, 0, (tensors, header)

    def opened(self, agent: int, contents: list[tuple[Tensors, ModelHeader]]) -> Arrived:
        ((tensors, header),) = contents
        return self._decoders[agent].decode(tensors), header

    def model(self, turn: Turn[Arrived]) -> tuple[bytes, int]:
        """The cluster's model as payload, and the batch gradients that it took."""
        arrived = dict(sorted(turn.arrived.items()))
        headers, ledger = [header for _, header in arrived.values()], self._ledgers[turn.task]
        for header in headers:
            ledger.merge(header.rewards)
        header = ModelHeader(
            task=turn.task,
            agent=0,
            round=turn.round,
            reward=ledger.cluster_reward(turn.round),
            samples=sum(header.samples for header in headers),
            rewards=ledger.newest(),
        )
        updates = {
            agent: Update(read_only(weights), theirs.samples, turn.round)
            for agent, (weights, theirs) in arrived.items()
        }
        batches = sum(map(self._scenario.batches, updates))
        round_ = ClusterRound(turn.task, turn.round, updates, batches=batches)
        model, gradients = served(self._methods[turn.task], round_, self._shapes)
        return self._told(turn.task, model, header, list(arrived)), gradients

    def kept(self, task: int) -> dict[str, Stateful]:
        decoders = {f"decoder-{agent}": self._decoders[agent] for agent in self._clusters[task]}
        untold, ledger = self._untold[task], self._ledgers[task]
        own: dict[str, Stateful] = {
            "ledger": ledger,
            "encoder": self._encoders[task],
            "untold": untold,
            "method": self._methods[task],
        }
        return {**own, **decoders}

    def _told(self, task: int, model: Weights, header: ModelHeader, robots: Sequence[int]) -> bytes:
        """The message that brings a cluster's robots to `model`, or as near as it can."""
        encoder = self._encoders[task]
        if untold := self._untold[task]:
            model = {name: tensor + untold[name] for name, tensor in model.items()}
        payload = encoder.payload(model, header, len(robots))
        if not self._codec.lossless:
            untold.update({name: tensor - encoder.public[name] for name, tensor in model.items()})
        for agent in robots:
            self._decoders[agent].rebase(encoder.public)
        return payload


class ExperienceService:
    """Robots' raw observations in, the task's model out: one learner a task, with all its robots' transitions."""

    word = "transition"

    def __init__(self, scenario: Scenario, arm: Arm, folder: Path | None = None, tally: TallyOf = nobody) -> None:
        """`folder`: for the frames of the replay memories; `tally`: counts batch gradients as they are computed."""
        self._scenario, self._arm, self._folder, self._tally = scenario, arm, folder, tally
        self._methods: dict[int, Method] = {task: scenario.method(arm.method) for task in scenario.clusters}
        self._learners = {task: self._learner(task) for task in scenario.clusters}
        self._walks = {task: Walks(learner.replay, scenario.motions) for task, learner in self._learners.items()}
        self._codec = experience_codec_of(scenario)
        self._encoders = {task: WeightsEncoder(codec_of(scenario)) for task in scenario.clusters}
        self._shapes: Shapes = shapes_of(build_qnetwork(scenario))

    def messages(self, agent: int) -> int:
        return self._scenario.motions(agent)

    def read(self, payload: Payload, task: int, agent: int) -> tuple[int, int, Motion]:
        """One motion of a robot.

        Raises:
            PayloadError: not a motion of this robot.
        """
        motion = read_motion(payload, self._scenario, self._codec)
        header = motion.header
        if (header.task, header.agent) != (task, agent):
            raise PayloadError(
                f"experience of robot {header.agent}, task {header.task}; expected robot {agent}, task {task}"
            )
        return header.round, header.motion, motion

    def opened(self, agent: int, contents: list[Motion]) -> list[Motion]:
        return contents

    def model(self, turn: Turn[list[Motion]]) -> tuple[bytes, int]:
        """The task's model after this round's steps as payload, and the batch gradients computed."""
        learner = self._learners[turn.task]
        for _, motions in sorted(turn.arrived.items()):
            self._walks[turn.task].remember(motions)
        batches = sum(map(self._scenario.batches, turn.arrived))
        round_ = ClusterRound(turn.task, turn.round, {}, learner, batches)
        model, gradients = served(self._methods[turn.task], round_, self._shapes)
        return self._encoders[turn.task].payload(
            model, ModelHeader(task=turn.task, agent=0, round=turn.round)
        ), gradients

    def kept(self, task: int) -> dict[str, Stateful]:
        learner, walks = self._learners[task], self._walks[task]
        return {"learner": learner, "walks": walks, "encoder": self._encoders[task], "method": self._methods[task]}

    def _learner(self, task: int) -> Learner:
        scenario = self._scenario
        # All robots' transitions in one memory, of the size that theirs have together.
        cluster, learning = scenario.cluster(task), scenario.learning
        motions = sum(map(scenario.motions, cluster))
        sizes = {"replay_size": len(cluster) * learning.replay_size, "motions_per_round": motions}
        settings = learning.model_copy(update=sizes)
        frames = self._folder / f"frames-{task}.bin" if self._folder else None
        rng = stream(scenario.seed, self._arm.name, "learn", task)
        weights, tally = start_weights(scenario, task), self._tally(task)
        return Learner(build_qnetwork(scenario), settings, weights, rng, frames, tally, self._methods[task].own_penalty)


def served(method: Method, round_: ClusterRound, shapes: Shapes) -> tuple[Weights, int]:
    """What a method makes of a cluster's round, looked at before it is sent.

    Raises:
        TrainingError: it is no model of this network, or not finite.
    """
    model, gradients = method.serve(round_)
    if wrong := unfit(model, shapes):
        raise TrainingError(f"method {method.name}, round {round_.round} of task {round_.task}: serve: {wrong}")
    return {name: model[name] for name in shapes}, gradients
