"""Whom a robot's weights go to, and what its method makes of theirs: neighbours, the data center, or nobody."""

from __future__ import annotations

from jouleswarm.agents.membership import Arrived
from jouleswarm.agents.peers import Exchange
from jouleswarm.agents.served import ServerLink
from jouleswarm.codecs.codec import share_of
from jouleswarm.common.disk.state import Stateful, Together
from jouleswarm.common.errors import TrainingError
from jouleswarm.common.scenario.sections import Federation
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.types import Weights
from jouleswarm.methods.contract import read_only, unfit
from jouleswarm.methods.method import DATACENTER, Method, Update
from jouleswarm.methods.mixing import default_step


class Partners:
    """A robot's partners in an arm: `meet` says its word of a round and waits for theirs, `mixed` the model after."""

    def __init__(self, exchange: Exchange, method: Method, settings: Federation) -> None:
        self._exchange, self._method = exchange, method
        self._link = ServerLink(exchange) if method.partners == "datacenter" else None
        self._step = settings.step or default_step(len(exchange.here.neighbours), share_of(exchange.codec))
        self._told: Weights = {}
        self._updates: dict[int, Update] = {}

    def meet(self, weights: Weights, header: ModelHeader) -> list[ModelHeader]:
        """Send `weights`; the headers of what came in return."""
        exchange = self._exchange
        exchange.publish_weights(weights, header)
        self._told = exchange.encoder.public
        arrived: Arrived
        if self._link is None:
            arrived = exchange.gather(header.round)
        else:
            arrived = {DATACENTER: self._link.await_model(header.round)}
            exchange.encoder.rebase(arrived[DATACENTER][0])  # which everybody has
        self._updates = {
            agent: Update(read_only(model), theirs.samples, theirs.round)
            for agent, (model, theirs) in sorted(arrived.items())
        }
        return [theirs for _, theirs in arrived.values()]

    def mixed(self, weights: Weights) -> Weights:
        """The model to go on from, by the method; this robot's own `weights` where nobody has answered.

        Raises:
            TrainingError: what the method makes is no model of the network, or not finite.
        """
        if not self._updates:
            return weights
        own, step = read_only(weights), self._step
        if self._exchange.codec.lossless:
            mixed = self._method.mix(own, self._updates, step)
        else:
            mixed = self._method.mix_lossy(own, read_only(self._told), self._updates, step)
        if wrong := unfit(mixed, {name: tensor.shape for name, tensor in own.items()}):
            raise TrainingError(f"method {self._method.name}: mix: {wrong}")
        return mixed

    @property
    def kept(self) -> Stateful:
        """What is kept of them; the exchange's own is apart."""
        link = {} if self._link is None else {"link": self._link.kept}
        return Together({**link, "method": self._method})
