"""A robot's part in meta-learning as the bus sees it: experience up while it is wanted, the meta-model down."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from jouleswarm.agents.peers import Exchange
from jouleswarm.codecs.models import read_model
from jouleswarm.codecs.streams import WeightsDecoder
from jouleswarm.common.bus.bus import Message
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import RoundRequest, decode_json, encode_json
from jouleswarm.common.wire.types import Shapes, Weights


class MetaLink:
    """What the robot's exchange says to and hears from a data center that meta-learns."""

    def __init__(self, exchange: Exchange, shapes: Callable[[str], Shapes]) -> None:
        """`shapes`: of an arm's model, which can hold more than the network (see jouleswarm/learning/heads.py)."""
        self._exchange, self._shapes = exchange, shapes
        self._wanted: dict[str, RoundRequest] = {}
        self._again: dict[str, set[int]] = {}
        self._models: dict[str, Weights] = {}
        exchange.handlers |= {"collect": self._take_collect, "meta": self._take_meta, "round": self._take_wanted}

    def listen(self, arms: Sequence[Arm]) -> None:
        """Listen to everything that the stages before these arms may say, before the robot says that it is here."""
        here, run, exchange = self._exchange.here, self._exchange.run, self._exchange
        # The meta-model before the round marker: a marker that says 'finished' then proves that the
        # meta-model went by before this robot came, and must be asked for.
        for arm in arms:
            models = (topics.meta_model(run, arm.name), topics.meta_model(run, arm.name, here.agent))
            exchange.subscribe(*models, qos=exchange.qos)
        for method in dict.fromkeys(arm.method for arm in arms):
            exchange.subscribe(topics.meta_round(run, method), topics.collect_again(run, method, here.task, here.agent))

    def await_rounds_due(self, method: str, sent: set[int], t0: int) -> list[int]:
        """The meta-learning rounds whose experience is to be sent now, in order; empty once the stage is over."""

        def due() -> set[int]:
            wanted = self._wanted_of(method)
            rounds = set(range(wanted.first, min(wanted.last, t0) + 1)) - {0}
            return (rounds - sent) | (self._again.get(method, set()) & set(range(1, t0 + 1)))

        self._exchange.until(
            lambda: bool(due()) or self._wanted_of(method).first > t0,
            lambda: "the data center to ask for experience",
            whom=lambda: [topics.DATACENTER],
        )
        rounds = sorted(due())
        self._again.pop(method, None)
        return rounds

    def publish_motion(self, arm: str, payload: bytes) -> None:
        """Send one motion's experience up."""
        topic = topics.experience(self._exchange.run, arm, self._exchange.here.task, self._exchange.here.agent)
        self._exchange.publish(topic, payload)

    def await_model(self, arm: Arm, t0: int) -> Weights:
        """The meta-model that `arm` starts from, asked for if it went by before this robot came.

        All of a method's meta-models go down when its stage of `t0` rounds is over.
        """

        def gone_by() -> bool:
            return self._wanted_of(arm.method).first > t0

        def ask() -> None:
            if arm.name not in self._models and gone_by():
                request = RoundRequest(first=self._exchange.here.agent, last=self._exchange.here.agent)
                self._exchange.publish(topics.meta_resend(self._exchange.run, arm.name), encode_json(request), qos=1)

        def what() -> str:
            return "the meta-model"

        self._exchange.until(lambda: arm.name in self._models or gone_by(), what, whom=lambda: [topics.DATACENTER])
        ask()
        self._exchange.until(lambda: arm.name in self._models, what, ask, whom=lambda: [topics.DATACENTER])
        return self._models.pop(arm.name)

    def _take_collect(self, message: Message) -> None:
        request = decode_json(message.payload, RoundRequest)
        again = self._again.setdefault(topics.arm_of(message.topic), set())
        again |= set(range(request.first, min(request.last, request.first + 1) + 1))

    def _take_meta(self, message: Message) -> None:
        codec, arm = self._exchange.codec, topics.arm_of(message.topic)
        shapes = self._shapes(arm)
        tensors, _ = read_model(message.payload, shapes, codec)
        self._models[arm] = WeightsDecoder(codec, shapes).decode(tensors)

    def _take_wanted(self, message: Message) -> None:
        if message.payload:
            self._wanted[topics.arm_of(message.topic)] = decode_json(message.payload, RoundRequest)

    def _wanted_of(self, method: str) -> RoundRequest:
        return self._wanted.get(method, RoundRequest(first=0, last=0))
