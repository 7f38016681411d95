"""The data center's ear: motions from the uplink, put in order, round by round."""

from __future__ import annotations

import itertools

from jouleswarm.codecs.observations import experience_codec_of
from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import RoundRequest, decode_json, encode_json
from jouleswarm.datacenter.experience import Motion, read_motion
from jouleswarm.datacenter.inbox import Desk, names


class Collector(Desk):
    """Receives the training robots' experience for one meta method, and asks again for what is missing."""

    def __init__(self, listener: Listener, scenario: Scenario, run: str, method: str) -> None:
        super().__init__(listener, scenario, run, method)
        self._codec = experience_codec_of(scenario)
        self._ready = 2 * scenario.arm_names.index(method) + 1
        self._training = {agent: task for task, agents in scenario.training_agents.items() for agent in agents}
        self._motions: dict[int, dict[int, dict[int, Motion]]] = {}  # round -> robot -> motion -> Motion
        self._asked_for_model: dict[tuple[str, int], None] = {}  # in the order of asking, each once
        self._collected = 0
        self.subscriptions += [
            *(topics.experience(run, method, task, agent) for agent, task in self._training.items()),
            *(topics.meta_resend(run, arm.name) for arm in scenario.arms if arm.method == method),
        ]

    def join(self, collected: int) -> None:
        """Listen; rounds up to `collected` are in hand already."""
        self._collected = collected
        self.listen()

    def announce_wanted(self, first: int, last: int) -> None:
        """Ask the training robots for rounds `first` to `last` (retained: those who come late hear it too)."""
        topic = topics.meta_round(self._run, self._arm)
        self._bus.publish(topic, encode_json(RoundRequest(first=first, last=last)), retain=True)

    def collect(self, round_: int) -> dict[int, list[list[Motion]]]:
        """Training task -> one list of motions, in order, for each of its robots (but those that are left out).

        Raises:
            RunError: a robot is past this method's stage.
        """
        asked = itertools.count(1)
        self._listener.until(
            lambda: not self._missing(round_),
            lambda: f"round {round_} of robots {self._missing(round_)}",
            lambda: self._ask_again(round_, self._missing(round_), begun_only=next(asked) == 1),
            whom=lambda: names(self._missing(round_)),
        )
        self._collected = round_
        arrived = self._motions.pop(round_, {})
        return {
            task: [
                [arrived[agent][motion] for motion in sorted(arrived[agent])] for agent in agents if agent in arrived
            ]
            for task, agents in self._scenario.training_agents.items()
        }

    def robots_that_missed_a_model(self) -> list[tuple[str, int]] | None:
        """(arm, robot) of those that ask for a meta-model again; None once every robot has begun to adapt it."""
        self._listener.until(
            lambda: bool(self._asked_for_model) or self.all_reached(self._ready),
            lambda: f"robots {self.behind(self._ready)} to take the meta-model",
            whom=lambda: names(self.behind(self._ready)),
        )
        asked, self._asked_for_model = self._asked_for_model, {}
        return list(asked) or None

    def _missing(self, round_: int) -> list[int]:
        arrived = self._motions.get(round_, {})
        behind = [agent for agent in self._training if len(arrived.get(agent, {})) < self._scenario.motions(agent)]
        for agent in behind:
            if self._stages[agent] >= self._ready:
                raise self.left_behind(f"robot {agent}", "past meta-learning", f"round {round_} of it")
        # A task that nothing has ever been heard of cannot be learned: that first round is waited for.
        return [agent for agent in behind if round_ == 1 or not self.is_left_out(agent)]

    def _ask_again(self, round_: int, agents: list[int], *, begun_only: bool) -> None:
        # A robot that has not come yet will hear of the wanted rounds when it does. One that has, but of whose round
        # nothing has come, may just be slow; or it sent the round to a data center that died, or while this
        # one was cut off, and will not send it again unasked.
        for agent in agents:
            if self._stages[agent] >= 0 and (not begun_only or self._motions.get(round_, {}).get(agent)):
                topic = topics.collect_again(self._run, self._arm, self._training[agent], agent)
                self._bus.publish(topic, encode_json(RoundRequest(first=round_, last=round_)))

    def take(self, message: Message) -> None:
        kind = message.topic.rsplit("/", 1)[-1]
        if kind == "experience":
            self._take_motion(message)
        elif kind == "resend":
            agent = decode_json(message.payload, RoundRequest).first
            if agent in self._stages:
                self._asked_for_model[topics.arm_of(message.topic), agent] = None
        else:
            super().take(message)

    def _take_motion(self, message: Message) -> None:
        _, _, _, _, task, agent, _ = message.topic.split("/")
        read = read_motion(message.payload, self._scenario, self._codec)
        header = read.header
        if (header.task, header.agent) != (int(task), int(agent)):
            raise PayloadError(
                f"experience of robot {header.agent}, task {header.task}; expected robot {agent}, task {task}"
            )
        motions, t0 = self._scenario.motions(header.agent), self._scenario.meta.t0
        if header.motion >= motions or header.round > min(self._collected + 2, t0):
            raise PayloadError(
                f"experience of round {header.round}, motion {header.motion}; expected rounds up to "
                f"{min(self._collected + 2, t0)} and motions below {motions}"
            )
        arrived = self._motions.get(header.round, {}).get(header.agent, {})
        if header.round <= self._collected or header.motion in arrived:
            self.repeated(message)
        else:
            self._motions.setdefault(header.round, {}).setdefault(header.agent, {})[header.motion] = read
