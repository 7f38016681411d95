"""What a robot says and hears: the bus seen with the robot's words.

Every wait ends when the condition holds, however late the others come: nothing is timed but the request to send again
what has not come, and for how long somebody may be silent (see common/bus/patience.py). A message that is not what its
topic promises is refused and counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from jouleswarm.agents.membership import Arrived, Membership
from jouleswarm.codecs.codec import Codec
from jouleswarm.codecs.floats import FLOAT32
from jouleswarm.codecs.models import read_model
from jouleswarm.codecs.streams import WeightsDecoder, WeightsEncoder
from jouleswarm.common.bus.bus import Bus, Message
from jouleswarm.common.bus.rounds import Rounds
from jouleswarm.common.disk.state import State
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.sections import Bus as BusSettings
from jouleswarm.common.scenario.sections import Federation
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import ModelHeader, RoundRequest, decode_json, encode_json
from jouleswarm.common.wire.types import Payload, Shapes, Tensors, Weights
from jouleswarm.methods.graph import Neighbourhood

T = TypeVar("T")


class Exchange(Membership):
    """Robot `agent`'s side of the protocol."""

    def __init__(
        self,
        bus: Bus,
        run: str,
        here: Neighbourhood,
        shapes: Shapes,
        settings: BusSettings,
        federation: Federation,
        rows: Path | None = None,
        codec: Codec = FLOAT32,
    ) -> None:
        """`rows`: a file that keeps the rows of a robot that was killed."""
        super().__init__(bus, run, here, settings, federation, rows)
        self._shapes, self.codec = shapes, codec
        self.encoder = WeightsEncoder(self.codec)
        self._ahead: Arrived = {}
        self._end_stage = 0
        self.missed: tuple[int, ...] = ()
        self._decoders: dict[int, WeightsDecoder] = {}
        self._rounds = Rounds((), self._decoded, self._listener.refuse)
        self._sent: dict[int, bytes] = {}
        self._word_topic = ""
        self._back_in = 0
        self.may_have_missed = True
        """Whether others may have said something to a robot that is back, for which it asks at once."""
        self.handlers |= {"weights": self._take_weights, "resend": self._take_resend}

    @property
    def newest_round(self) -> int:
        return max(self._sent, default=0)

    def open_arm(
        self, arm: Arm, here: Neighbourhood, end_stage: int, says: Callable[..., str] = topics.weights
    ) -> None:
        """Listen to the neighbours' weights of this arm, `here` being its neighbourhood.

        `end_stage`: of robots that are done with the arm; `says`: the topic of this robot's word of a round.
        """
        run = self.run
        self.here, self._end_stage, self._ahead, self.may_have_missed = here, end_stage, {}, True
        self._back_in = 0  # the first round since this robot is back, of which others may have spoken meanwhile
        self.arm, self._sent, self._rounds = arm.name, {}, self.rounds(here.neighbours, self._decoded)
        self._identity.rewards = {}
        self.encoder = WeightsEncoder(self.codec)
        self._decoders = {each: self.decoder() for each in here.neighbours}
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
        self._listener.take_waiting()
        self._sent = {round_: payload, **{r: p for r, p in self._sent.items() if r == round_ - 1}}
        self._say(round_)

    def gather(self, round_: int) -> Arrived:
        """The neighbours' weights of `round_`, as they come out of the codec.

        All of them; unless going on without the missing is allowed: then `missed` tells whose have not come.

        Raises:
            RunError: a neighbour is so far ahead that it has been here with this robot.
        """
        self._absence.begin()

        def waited_for() -> list[int]:
            missing = self._rounds.missing()
            for each in missing:
                self._check_stage(each, self._stages.get(each, 0), self._end_stage - 1)
            return [] if self.ahead else self._absence.waited_for([each for each in missing if not self._past(each)])

        self._rounds.go_to(round_ - 1)
        self.await_round(round_, waited_for, "round {round} of robots {{}}", topics.resend)
        self.missed = tuple(self._rounds.missing())
        return self._rounds.take()

    def await_round(
        self,
        round_: int,
        missing: Callable[[], Sequence[int]],
        what: str,
        again: Callable[[str, str, int, int], str],
    ) -> None:
        """Wait until no robot's word of a round is `missing`, asked for on the topic `again`; `what`: to say so.

        Raises:
            RunError: it does not come.
        """

        def ask(robot: int) -> None:
            request = encode_json(RoundRequest(first=round_, last=round_))
            self._bus.publish(again(self.run, self.arm, self.here.task, robot), request)

        self.awaited_round = round_
        at_once = round_ == self._back_in and self.may_have_missed
        self._listener.until_none_is(missing, what.format(round=round_), ask, at_once=at_once)
        self.awaited_round = 0

    @property
    def ahead(self) -> int:
        """The newest round heard of where neighbours have gone on without this robot; 0 if they have not."""
        return max((header.round for _, header in self._ahead.values()), default=0)

    def rounds(self, senders: Iterable[int], opened: Callable[[int, list[Any]], T]) -> Rounds[T]:
        """What comes from `senders` in the open arm; what does not open is refused as other bad messages are."""
        return Rounds(senders, opened, self._listener.refuse)

    def _decoded(self, agent: int, word: list[tuple[Tensors, ModelHeader]]) -> tuple[Weights, ModelHeader]:
        ((tensors, header),) = word
        return self._decoders[agent].decode(tensors), header

    def catch_up(self) -> Weights:
        """The newest model of a neighbour that has gone on; its round is this robot's newest from here on."""
        newest = max(self._ahead, key=lambda each: self._ahead[each][1].round)
        weights, header = self._ahead[newest]
        self._decoders[newest].rebase(weights)
        self._ahead = {}
        self._rounds.clear(header.round)
        return weights

    def _past(self, agent: int) -> bool:
        """Whether a neighbour will not send this round any more: it has ended, or caught up with a later one."""
        later = self._rounds.has_of(agent, self._rounds.done + 2)
        return self._absence.is_tolerated and (later or self._stages.get(agent, 0) >= self._end_stage)

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
        self._reporter.deliver(topics.learned(self.run, self.arm, self.here.task), payload)

    def state(self) -> State:
        """The open arm's, at the end of a round: what neighbours may still ask for, and what the codec builds on."""
        said = {str(round_): np.frombuffer(payload, np.uint8) for round_, payload in self._sent.items()}
        decoders = {f"decoder-{agent}": decoder.state() for agent, decoder in self._decoders.items()}
        start = State(values={str(agent): reward for agent, reward in self._identity.rewards.items()})
        return State.of({"said": State(said), "encoder": self.encoder.state(), "start": start, **decoders})

    def load_state(self, state: State) -> None:
        """Take up what `state` returned, after `open_arm`."""
        self._sent = {int(round_): payload.tobytes() for round_, payload in state.part("said").arrays.items()}
        self._rounds.go_to(done := max(self._sent, default=0))
        self._back_in = done + 1
        self._identity.rewards = {int(agent): reward for agent, reward in state.part("start").values.items()}
        self.encoder.load_state(state.part("encoder"))
        for agent, decoder in self._decoders.items():
            decoder.load_state(state.part(f"decoder-{agent}"))

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
        self._absence.here(agent)
        if header.round > self._rounds.last:
            if self._absence.is_tolerated:
                self._ahead[agent] = self._decoders[agent].decoded(tensors), header
        elif not self._rounds.put(header.round, agent, (tensors, header)):
            self.repeated(message)

    def _take_resend(self, message: Message) -> None:
        request = decode_json(message.payload, RoundRequest)
        if request.first in self._sent:
            self._say(request.first)

    def _say(self, round_: int) -> None:
        self._bus.publish(self._word_topic, self._sent[round_], qos=self.qos)
