"""What a robot says and hears: the bus seen with the robot's words.

Every wait ends when the condition holds, however late the others come: nothing is timed but the request
to send again what has not come. A message that is not what its topic promises is refused and counted.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence

from agents.neighbourhood import Neighbourhood
from common import topics
from common.bus import Bus, Message, Payload
from common.codecs import FLOAT32, Shapes, Tensors, Weights, WeightsCodec
from common.errors import PayloadError
from common.methods import SERVED_METHODS, Arm
from common.payloads import ModelHeader, Presence, RoundRequest, decode_json, encode_json, read_model
from common.reports import leave, publish_row
from common.runlog import RoundRow
from common.streams import WeightsDecoder, WeightsEncoder

log = logging.getLogger("jouleswarm.agent")

Arrived = dict[int, tuple[Weights, ModelHeader]]


class Exchange:
    """Robot `agent`'s side of the protocol. One thread."""

    def __init__(
        self,
        bus: Bus,
        run: str,
        here: Neighbourhood,
        shapes: Shapes,
        qos: int,
        resend_after_s: float,
        codec: WeightsCodec = FLOAT32,
    ) -> None:
        self._bus, self.run, self.here, self._shapes = bus, run, here, shapes
        self.qos, self._resend_after_s, self.codec = qos, resend_after_s, codec
        self.encoder = WeightsEncoder(codec)
        self._decoders: dict[int, WeightsDecoder] = {}
        self._stages: dict[int, int] = dict.fromkeys(here.neighbours, 0)
        self._datacenter_stage = 0
        self._arrived: dict[int, dict[int, tuple[Tensors, ModelHeader]]] = {}  # decoded in the order of rounds
        self._sent: dict[int, bytes] = {}
        self.arm, self._word_topic = "", ""
        self._subscriptions: list[str] = []
        self._gathered = 0
        self.refused = 0
        self.handlers: dict[str, Callable[[Message], None]] = {
            "weights": self._take_weights,
            "presence": self._take_presence,
            "resend": self._take_resend,
        }
        """What is done with a message, by the last level of its topic."""

    def join(self, arms: Sequence[Arm]) -> None:
        """Listen to where the neighbours are, then say hello."""
        here, run = self.here, self.run
        self.subscribe(*(topics.presence(run, here.task, each) for each in here.neighbours))
        if any(arm.method in SERVED_METHODS for arm in arms):
            self.subscribe(topics.presence(run, 0, 0))
        self.announce(0)

    def announce(self, stage: int) -> None:
        """Tell the neighbours and the data center how far this robot has come."""
        presence = Presence(agent=self.here.agent, stage=stage)
        self._bus.publish(
            topics.presence(self.run, self.here.task, self.here.agent), encode_json(presence), retain=True
        )

    def await_datacenter(self, stage: int) -> None:
        """Wait until the data center serves the arm that `stage` opens."""
        self.until(lambda: self._datacenter_stage >= stage, lambda: "the data center to come")

    def await_stage(self, stage: int) -> None:
        """Wait until every neighbour has come as far as `stage`; serves requests meanwhile."""
        self.until(
            lambda: all(reached >= stage for reached in self._stages.values()),
            lambda: f"robots {[each for each, reached in self._stages.items() if reached < stage]} to come",
        )

    def open_arm(self, arm: Arm, here: Neighbourhood) -> None:
        """Listen to the neighbours' weights of this arm, `here` being its neighbourhood."""
        run = self.run
        self.here = here
        self.arm, self._arrived, self._sent, self._gathered = arm.name, {}, {}, 0
        self.encoder = WeightsEncoder(self.codec)
        self._decoders = {each: self.decoder() for each in here.neighbours}
        says = {"fedavg": topics.weights_up, "centralized": topics.episode}.get(arm.method, topics.weights)
        self._word_topic = says(run, arm.name, here.task, here.agent)
        self.subscribe(*(topics.weights(run, arm.name, here.task, each) for each in here.neighbours), qos=self.qos)
        self.subscribe(topics.resend(run, arm.name, here.task, here.agent))

    def publish_weights(self, weights: Weights, header: ModelHeader) -> bytes:
        """Send this round's weights to the neighbours; kept for a round in case they ask again."""
        payload = self.encoder.payload(weights, header, len(self.here.cluster))
        self.publish_round(header.round, payload)
        return payload

    def publish_round(self, round_: int, payload: bytes) -> None:
        """Say this round's word on the arm's topic; kept for a round in case somebody asks again."""
        # Requests that came before there was anything to send are served by what is sent now.
        while (message := self._bus.receive(0)) is not None:
            self._take(message)
        self._sent = {round_: payload, **{r: p for r, p in self._sent.items() if r == round_ - 1}}
        self._say(round_)

    def gather(self, round_: int) -> Arrived:
        """The neighbours' weights of `round_`, all of them, as they come out of the codec."""
        self._arrived.setdefault(round_, {})

        def missing() -> list[int]:
            return [each for each in self.here.neighbours if each not in self._arrived[round_]]

        def ask() -> None:
            for each in missing():
                topic = topics.resend(self.run, self.arm, self.here.task, each)
                self._bus.publish(topic, encode_json(RoundRequest(first=round_, last=round_)))

        self.until(lambda: not missing(), lambda: f"round {round_} of robots {missing()}", ask)
        self._gathered = round_
        arrived = self._arrived.pop(round_)
        return {each: (self._decoders[each].decode(tensors), header) for each, (tensors, header) in arrived.items()}

    def report(self, row: RoundRow) -> None:
        """Telemetry: one row of the run log."""
        publish_row(self._bus, self.run, row)

    def publish(self, topic: str, payload: bytes, qos: int | None = None) -> None:
        """Send something, at the scenario's QoS unless told otherwise."""
        self._bus.publish(topic, payload, qos=self.qos if qos is None else qos)

    def read(self, payload: Payload) -> tuple[Tensors, ModelHeader]:
        """A model of this run's shape and codec, for a decoder.

        Raises:
            PayloadError: it is not one.
        """
        return read_model(payload, self._shapes, self.codec)

    def decoder(self) -> WeightsDecoder:
        """For the models of one sender in one arm."""
        return WeightsDecoder(self.codec, self._shapes)

    def hand_in(self, payload: bytes) -> None:
        """The cluster's learned weights, for the run directory."""
        self._bus.publish(topics.learned(self.run, self.arm, self.here.task), payload)

    def leave(self) -> None:
        """Hand in the byte counters and disconnect."""
        presence = topics.presence(self.run, self.here.task, self.here.agent)
        leave(self._bus, self.run, self._subscriptions, presence)

    def subscribe(self, *filters: str, qos: int = 1) -> None:
        """Subscribe until the robot leaves."""
        if filters:
            self._bus.subscribe(*filters, qos=qos)
            self._subscriptions += filters

    def until(
        self, condition: Callable[[], bool], what: Callable[[], str], ask_again: Callable[[], None] | None = None
    ) -> None:
        """Take messages until `condition` holds; after each quiet spell say what is missing, and ask for it."""
        quiet_from = time.monotonic()
        while not condition():
            message = self._bus.receive(self._resend_after_s)
            if message is not None:
                self._take(message)
            if time.monotonic() - quiet_from >= self._resend_after_s and not condition():
                log.info("waiting for %s", what())
                if ask_again is not None:
                    ask_again()
                quiet_from = time.monotonic()

    def _take(self, message: Message) -> None:
        """Sort one message into place; refuse and count what is not what its topic promises."""
        kind = message.topic.rsplit("/", 1)[-1]
        try:
            self.handlers[kind](message)
        except PayloadError as error:
            self.refused += 1
            log.warning("refused a message on %s: %s", message.topic, error)

    def _take_weights(self, message: Message) -> None:
        if topics.arm_of(message.topic) != self.arm:  # an answer to a request of the arm before, come late
            return
        agent = int(message.topic.split("/")[5])
        tensors, header = self.read(message.payload)
        told = header.reward is not None and header.rewards.get(agent, (0, 0.0))[0] == header.round
        if (header.agent, header.task) != (agent, self.here.task) or not told or header.samples < 1:
            raise PayloadError(
                f"model of robot {header.agent}, task {header.task}, reward {header.reward}, rewards {header.rewards}, "
                f"samples {header.samples}; expected robot {agent}, task {self.here.task}, its rewards and samples"
            )
        # A neighbour can be two rounds ahead of what was last gathered, never more; older ones are duplicates.
        if self._gathered < header.round <= self._gathered + 2:
            self._arrived.setdefault(header.round, {})[agent] = (tensors, header)

    def _take_presence(self, message: Message) -> None:
        if not message.payload:
            return
        presence = decode_json(message.payload, Presence)
        if presence.agent != int(message.topic.split("/")[5]):
            raise PayloadError(f"presence of robot {presence.agent}, expected the topic's")
        if presence.state == "gone":
            log.warning(
                "%s is gone; waiting for it to come back",
                f"robot {presence.agent}" if presence.agent else "data center",
            )
        elif presence.agent == 0:
            self._datacenter_stage = presence.stage
        elif presence.agent in self._stages:
            self._stages[presence.agent] = presence.stage

    def _take_resend(self, message: Message) -> None:
        request = decode_json(message.payload, RoundRequest)
        if request.first in self._sent:
            self._say(request.first)

    def _say(self, round_: int) -> None:
        self._bus.publish(self._word_topic, self._sent[round_], qos=self.qos)
