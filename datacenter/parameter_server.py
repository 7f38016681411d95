"""Federated averaging by a parameter server (McMahan et al. 2017): the `fedavg` method's work in a round."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from jouleswarm.codecs.codec import Array, Shapes, Tensors, Weights
from jouleswarm.codecs.streams import WeightsDecoder, WeightsEncoder
from jouleswarm.common.bus.bus import Payload
from jouleswarm.common.disk.state import State
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.meter.work import TallyOf, nobody
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import ModelHeader, read_model
from jouleswarm.datacenter.cluster_rounds import Turn
from jouleswarm.learning.networks import build_qnetwork, shapes_of
from jouleswarm.methods.ledger import RewardLedger

Arrived = tuple[Tensors, ModelHeader]


class ParameterServer:
    """Averages a cluster's weights by their |E_k| and tells each robot what all others were rewarded.

    With a lossy codec it keeps what its message could not tell for the next average (error feedback, as in Sattler
    et al. 2019); robots' messages build on the average that they have all been sent.
    """

    word, per_robot = "weights", 1

    def __init__(self, scenario: Scenario, folder: Path | None = None, tally: TallyOf = nobody) -> None:
        """`folder`: not needed, everything is in `state`; `tally`: no gradient is computed here."""
        self._clusters = scenario.clusters
        self._shapes: Shapes = shapes_of(build_qnetwork(scenario))
        self._codec = scenario.federation.weights_codec
        window = scenario.federation.reward_window
        self._ledgers = {task: RewardLedger(cluster, 1, window) for task, cluster in scenario.clusters.items()}
        self._encoders = {task: WeightsEncoder(self._codec) for task in scenario.clusters}
        self._decoders = {agent: WeightsDecoder(self._codec, self._shapes) for agent in scenario.agents}
        self._untold: dict[int, Weights] = {}

    def read(self, payload: Payload, task: int, agent: int) -> tuple[int, int, Arrived]:
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

    def model(self, turn: Turn[Arrived]) -> tuple[bytes, int]:
        """The cluster's average as payload; no gradient is computed here."""
        arrived = {agent: parts[0] for agent, parts in sorted(turn.arrived.items())}
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
        models = [self._decoders[agent].decode(tensors) for agent, (tensors, _) in arrived.items()]
        average = weighted_average(models, [header.samples for header in headers])
        return self._told(turn.task, average, header, list(arrived)), 0

    def state(self, task: int) -> State:
        """See `datacenter.cluster_rounds.Service`."""
        decoders = {f"decoder-{agent}": self._decoders[agent].state() for agent in self._clusters[task]}
        untold = State(dict(self._untold.get(task, {})))
        ledger, encoder = self._ledgers[task].state(), self._encoders[task].state()
        return State.of({"ledger": ledger, "encoder": encoder, "untold": untold, **decoders})

    def load_state(self, task: int, state: State) -> None:
        """See `datacenter.cluster_rounds.Service`."""
        self._ledgers[task].load_state(state.part("ledger"))
        self._encoders[task].load_state(state.part("encoder"))
        if untold := state.part("untold").arrays:
            self._untold[task] = untold
        for agent in self._clusters[task]:
            self._decoders[agent].load_state(state.part(f"decoder-{agent}"))

    def _told(self, task: int, average: Weights, header: ModelHeader, robots: Sequence[int]) -> bytes:
        """The message that brings a cluster's robots to `average`, or as near as it can."""
        encoder = self._encoders[task]
        if untold := self._untold.get(task):
            average = {name: tensor + untold[name] for name, tensor in average.items()}
        payload = encoder.payload(average, header, len(robots))
        if not self._codec.is_lossless:
            self._untold[task] = {name: tensor - encoder.public[name] for name, tensor in average.items()}
        for agent in robots:
            self._decoders[agent].rebase(encoder.public)
        return payload


def weighted_average(models: Sequence[Mapping[str, Array]], samples: Sequence[int]) -> Weights:
    """sum_k |E_k| W_k / sum_k |E_k|, float32, added up in the order given."""
    shares = [np.float32(count / sum(samples)) for count in samples]
    return {
        name: sum(
            (share * model[name] for share, model in zip(shares, models, strict=True)), np.zeros_like(models[0][name])
        )
        for name in models[0]
    }
