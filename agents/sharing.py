"""How the robots of a cluster come to one model, as the federated loop sees it: share, then take what is mixed."""

from __future__ import annotations

from typing import Protocol

from jouleswarm.agents.peers import Arrived, Exchange
from jouleswarm.agents.served import ServerLink
from jouleswarm.codecs.codec import share_of
from jouleswarm.common.disk.state import State
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.types import Weights
from jouleswarm.methods.consensus import default_step, mix, mixing_weights


class Sharing(Protocol):
    """One round: `share` says this robot's word and waits for the others', `mixed` is the model to go on from."""

    def share(self, weights: Weights, header: ModelHeader) -> list[ModelHeader]:
        """Send `weights`; the headers of what came in return."""

    def mixed(self, weights: Weights) -> Weights:
        """The round's mixed model, from this robot's own `weights`."""

    def state(self) -> State:
        """See `common.disk.state.Stateful`; the exchange's own is apart."""

    def load_state(self, state: State) -> None:
        """See `common.disk.state.Stateful`."""


class Consensus:
    """Decentralized federated averaging over the sidelinks, eq. (6); without neighbours nothing is mixed."""

    def __init__(self, exchange: Exchange, step: float) -> None:
        self._exchange, self._step = exchange, step
        self._arrived: Arrived = {}

    def share(self, weights: Weights, header: ModelHeader) -> list[ModelHeader]:
        self._exchange.publish_weights(weights, header)
        self._arrived = self._exchange.gather(header.round)
        return [theirs for _, theirs in self._arrived.values()]

    def mixed(self, weights: Weights) -> Weights:
        if not self._arrived:
            return weights
        sigma = mixing_weights({each: theirs.samples for each, (_, theirs) in self._arrived.items()})
        others = {each: theirs for each, (theirs, _) in self._arrived.items()}
        return mix(weights, others, sigma, self._step, self._exchange.encoder.public)

    def state(self) -> State:
        return State()

    def load_state(self, state: State) -> None:
        pass


class ParameterServer:
    """Federated averaging by the data center (McMahan et al. 2017): weights up, the cluster's average down.

    With a lossy codec the robot keeps on top of the average what its message could not tell (error feedback, as in
    Sattler et al. 2019), and its next message builds on the average, which everybody has.
    """

    def __init__(self, link: ServerLink, exchange: Exchange) -> None:
        self._link, self._exchange = link, exchange
        self._sent: Weights = {}
        self._average: Weights = {}

    def share(self, weights: Weights, header: ModelHeader) -> list[ModelHeader]:
        encoder = self._exchange.encoder
        self._exchange.publish_weights(weights, header)
        self._sent = encoder.public
        self._average, average = self._link.await_model(header.round)
        encoder.rebase(self._average)
        return [average]

    def mixed(self, weights: Weights) -> Weights:
        if self._exchange.codec.lossless:
            return self._average
        return {name: self._average[name] + (tensor - self._sent[name]) for name, tensor in weights.items()}

    def state(self) -> State:
        return self._link.state()

    def load_state(self, state: State) -> None:
        self._link.load_state(state)


def sharing_of(arm: Arm, exchange: Exchange, scenario: Scenario, neighbours: int) -> Sharing:
    """What the arm's method shares by."""
    if arm.method == "fedavg":
        return ParameterServer(ServerLink(exchange), exchange)
    return Consensus(exchange, scenario.federation.step or default_step(neighbours, share_of(exchange.codec)))
