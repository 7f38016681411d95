"""Federated averaging by a parameter server (McMahan et al. 2017): the `fedavg` method's work in a round."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from common.bus import Payload
from common.errors import PayloadError
from common.payloads import Array, ModelHeader, Shapes, decode_model, encode_model
from common.qnetwork import build_qnetwork, shapes_of
from common.rewards import RewardLedger
from common.scenario import Scenario
from datacenter.cluster_desk import Turn

Arrived = tuple[dict[str, Array], ModelHeader]


class ParameterServer:
    """Averages a cluster's weights by their |E_k| and tells each robot what all others were rewarded."""

    word, per_robot = "weights", 1

    def __init__(self, scenario: Scenario) -> None:
        self._shapes: Shapes = shapes_of(build_qnetwork(scenario.network))
        window = scenario.federation.reward_window
        self._ledgers = {task: RewardLedger(cluster, 1, window) for task, cluster in scenario.clusters.items()}

    def read(self, payload: Payload, task: int, agent: int) -> tuple[int, int, Arrived]:
        """A robot's weights of a round.

        Raises:
            PayloadError: not this robot's weights, its reward and its number of samples.
        """
        weights, header = decode_model(payload, self._shapes)
        if (header.task, header.agent) != (task, agent) or agent not in header.rewards or header.samples < 1:
            raise PayloadError(
                f"model of robot {header.agent}, task {header.task}, samples {header.samples}, rewards "
                f"{header.rewards}; expected robot {agent}, task {task}, its reward and samples"
            )
        return header.round, 0, (weights, header)

    def model(self, turn: Turn[Arrived]) -> tuple[bytes, int]:
        """The cluster's average as payload; no gradient is computed here."""
        arrived = [parts[0] for _, parts in sorted(turn.arrived.items())]
        ledger = self._ledgers[turn.task]
        for _, header in arrived:
            ledger.merge(header.rewards)
        average = weighted_average([weights for weights, _ in arrived], [header.samples for _, header in arrived])
        header = ModelHeader(
            task=turn.task,
            agent=0,
            round=turn.round,
            reward=ledger.cluster_reward(turn.round),
            samples=sum(header.samples for _, header in arrived),
            rewards=ledger.newest(),
        )
        return encode_model(average, header, len(arrived)), 0


def weighted_average(models: Sequence[Mapping[str, Array]], samples: Sequence[int]) -> dict[str, Array]:
    """sum_k |E_k| W_k / sum_k |E_k|, float32, added up in the order given."""
    shares = [np.float32(count / sum(samples)) for count in samples]
    return {
        name: sum(
            (share * model[name] for share, model in zip(shares, models, strict=True)), np.zeros_like(models[0][name])
        )
        for name in models[0]
    }
