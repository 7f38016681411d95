"""What a robot says and hears: the bus seen with the robot's words.

Every wait ends when the condition holds, however late the others come: nothing is timed but the request
to send again what has not come. A message that is not what its topic promises is refused and counted.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from agents.neighbourhood import Neighbourhood
from common import topics
from common.bus import Bus, Message
from common.errors import PayloadError
from common.payloads import (
    Array,
    ModelHeader,
    Presence,
    RoundRequest,
    Shapes,
    Weights,
    decode_json,
    decode_model,
    encode_json,
    encode_model,
)
from common.reports import leave, publish_row
from common.runlog import RoundRow

log = logging.getLogger("jouleswarm.agent")

Arrived = dict[int, tuple[dict[str, Array], ModelHeader]]


class Exchange:
    """Robot `agent`'s side of the protocol. One thread."""

    def __init__(
        self, bus: Bus, run: str, here: Neighbourhood, shapes: Shapes, qos: int, resend_after_s: float
    ) -> None:
        self._bus, self._run, self._here, self._shapes = bus, run, here, shapes
        self._qos, self._resend_after_s = qos, resend_after_s
        self._stages: dict[int, int] = dict.fromkeys(here.neighbours, 0)
        self._arrived: dict[int, Arrived] = {}
        self._sent: dict[int, bytes] = {}
        self._arm = ""
        self._subscriptions: list[str] = []
        self._wanted = RoundRequest(first=0, last=0)
        self._again: set[int] = set()
        self._meta: dict[str, Array] | None = None
        self._gathered = 0
        self.refused = 0

    def join(self, *, arm: str) -> None:
        """Listen to everything that the meta-learning stage and the neighbours may say, then say hello."""
        here, run = self._here, self._run
        self._subscribe(*(topics.presence(run, here.task, each) for each in here.neighbours))
        # The meta-model before the round marker: a marker that says 'finished' then proves that the
        # meta-model went by before this robot came, and must be asked for.
        self._subscribe(topics.meta_model(run, arm), topics.meta_model(run, arm, here.agent), qos=self._qos)
        self._subscribe(topics.meta_round(run, arm), topics.collect_again(run, arm, here.task, here.agent))
        self.announce(0)

    def announce(self, stage: int) -> None:
        """Tell the neighbours and the data center how far this robot has come."""
        presence = Presence(agent=self._here.agent, stage=stage)
        self._bus.publish(
            topics.presence(self._run, self._here.task, self._here.agent), encode_json(presence), retain=True
        )

    def await_stage(self, stage: int) -> None:
        """Wait until every neighbour has come as far as `stage`; serves requests meanwhile."""
        self._until(
            lambda: all(reached >= stage for reached in self._stages.values()),
            lambda: f"robots {[each for each, reached in self._stages.items() if reached < stage]} to come",
        )

    def await_rounds_due(self, sent: set[int], t0: int) -> list[int]:
        """The MAML rounds whose experience is to be sent now, in order; empty once the stage is over."""

        def due() -> set[int]:
            wanted = set(range(self._wanted.first, min(self._wanted.last, t0) + 1)) - {0}
            return (wanted - sent) | self._again

        self._until(lambda: bool(due()) or self._wanted.first > t0, lambda: "the data center to ask for experience")
        rounds = sorted(due())
        self._again.clear()
        return rounds

    def publish_motion(self, arm: str, payload: bytes) -> None:
        """Send one motion's experience up."""
        topic = topics.experience(self._run, arm, self._here.task, self._here.agent)
        self._bus.publish(topic, payload, qos=self._qos)

    def await_meta_model(self, arm: str, t0: int) -> dict[str, Array]:
        """The meta-model of `t0` rounds, asked for if it went by before this robot came."""

        def ask() -> None:
            if self._meta is None and self._wanted.first > t0:
                request = RoundRequest(first=self._here.agent, last=self._here.agent)
                self._bus.publish(topics.meta_resend(self._run, arm), encode_json(request))

        self._until(lambda: self._meta is not None or self._wanted.first > t0, lambda: "the meta-model")
        ask()
        self._until(lambda: self._meta is not None, lambda: "the meta-model", ask)
        assert self._meta is not None
        return self._meta

    def open_arm(self, arm: str) -> None:
        """Listen to the neighbours' weights of this arm."""
        here = self._here
        self._arm, self._arrived, self._sent, self._gathered = arm, {}, {}, 0
        self._subscribe(*(topics.weights(self._run, arm, here.task, each) for each in here.neighbours), qos=self._qos)
        self._subscribe(topics.resend(self._run, arm, here.task, here.agent))

    def publish_weights(self, weights: Weights, header: ModelHeader) -> bytes:
        """Send this round's weights to the neighbours; kept for a round in case they ask again."""
        # Requests that came before there was anything to send are served by what is sent now.
        while (message := self._bus.receive(0)) is not None:
            self._take(message)
        payload = encode_model(weights, header, len(self._here.cluster))
        self._sent = {header.round: payload, **{r: p for r, p in self._sent.items() if r == header.round - 1}}
        self._publish_round(header.round)
        return payload

    def gather(self, round_: int) -> Arrived:
        """The neighbours' weights of `round_`, all of them."""
        self._arrived.setdefault(round_, {})

        def missing() -> list[int]:
            return [each for each in self._here.neighbours if each not in self._arrived[round_]]

        def ask() -> None:
            for each in missing():
                topic = topics.resend(self._run, self._arm, self._here.task, each)
                self._bus.publish(topic, encode_json(RoundRequest(first=round_, last=round_)))

        self._until(lambda: not missing(), lambda: f"round {round_} of robots {missing()}", ask)
        self._gathered = round_
        return self._arrived.pop(round_)

    def report(self, row: RoundRow) -> None:
        """Telemetry: one row of the run log."""
        publish_row(self._bus, self._run, row)

    def hand_in(self, payload: bytes) -> None:
        """The cluster's learned weights, for the run directory."""
        self._bus.publish(topics.learned(self._run, self._arm, self._here.task), payload)

    def leave(self) -> None:
        """Hand in the byte counters and disconnect."""
        presence = topics.presence(self._run, self._here.task, self._here.agent)
        leave(self._bus, self._run, self._subscriptions, presence)

    def _subscribe(self, *filters: str, qos: int = 1) -> None:
        if filters:
            self._bus.subscribe(*filters, qos=qos)
            self._subscriptions += filters

    def _until(
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
        take = {
            "weights": self._take_weights,
            "presence": self._take_presence,
            "resend": self._take_resend,
            "collect": self._take_collect,
            "meta": self._take_meta,
            "round": self._take_wanted,
        }[kind]
        try:
            take(message)
        except PayloadError as error:
            self.refused += 1
            log.warning("refused a message on %s: %s", message.topic, error)

    def _take_weights(self, message: Message) -> None:
        if topics.arm_of(message.topic) != self._arm:  # an answer to a request of the arm before, come late
            return
        agent = int(message.topic.split("/")[5])
        weights, header = decode_model(message.payload, self._shapes)
        told = header.reward is not None and header.rewards.get(agent, (0, 0.0))[0] == header.round
        if (header.agent, header.task) != (agent, self._here.task) or not told or header.samples < 1:
            raise PayloadError(
                f"model of robot {header.agent}, task {header.task}, reward {header.reward}, rewards {header.rewards}, "
                f"samples {header.samples}; expected robot {agent}, task {self._here.task}, its rewards and samples"
            )
        # A neighbour can be two rounds ahead of what was last gathered, never more; older ones are duplicates.
        if self._gathered < header.round <= self._gathered + 2:
            self._arrived.setdefault(header.round, {})[agent] = (weights, header)

    def _take_presence(self, message: Message) -> None:
        if not message.payload:
            return
        presence = decode_json(message.payload, Presence)
        if presence.state == "gone":
            log.warning("robot %d is gone; waiting for it to come back", presence.agent)
        elif presence.agent in self._stages:
            self._stages[presence.agent] = presence.stage

    def _take_resend(self, message: Message) -> None:
        request = decode_json(message.payload, RoundRequest)
        if request.first in self._sent:
            self._publish_round(request.first)

    def _take_collect(self, message: Message) -> None:
        request = decode_json(message.payload, RoundRequest)
        self._again |= set(range(request.first, min(request.last, request.first + 1) + 1))

    def _take_meta(self, message: Message) -> None:
        self._meta, _ = decode_model(message.payload, self._shapes)

    def _take_wanted(self, message: Message) -> None:
        if message.payload:
            self._wanted = decode_json(message.payload, RoundRequest)

    def _publish_round(self, round_: int) -> None:
        topic = topics.weights(self._run, self._arm, self._here.task, self._here.agent)
        self._bus.publish(topic, self._sent[round_], qos=self._qos)
