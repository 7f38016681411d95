"""The data center's ear: motions from the uplink, put in order, round by round."""

from __future__ import annotations

from jouleswarm.codecs.observations import experience_codec_of
from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.bus.patience import left_behind
from jouleswarm.common.bus.rounds import Rounds
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import RoundRequest, decode_json, encode_json
from jouleswarm.common.wire.names import clients_of
from jouleswarm.datacenter.experience import Motion, read_motion
from jouleswarm.datacenter.inbox import Desk


class Collector(Desk):
    """Receives the training robots' experience for one meta method, and asks again for what is missing."""

    def __init__(self, listener: Listener, scenario: Scenario, run: str, method: str) -> None:
        super().__init__(listener, scenario, run, method)
        self._codec = experience_codec_of(scenario)
        self._ready = 2 * scenario.arm_names.index(method) + 1
        self._training = {agent: task for task, agents in scenario.training_agents.items() for agent in agents}
        self._rounds: Rounds[list[Motion]] = Rounds(
            self._training, lambda _, motions: motions, listener.refuse, scenario.motions, scenario.meta.t0
        )
        self._asked_for_model: dict[tuple[str, int], None] = {}  # in the order of asking, each once
        self.subscriptions += [
            *(topics.experience(run, method, task, agent) for agent, task in self._training.items()),
            *(topics.meta_resend(run, arm.name) for arm in scenario.arms if arm.method == method),
        ]

    def join(self, collected: int) -> None:
        """Listen; rounds up to `collected` are in hand already."""
        self._rounds.go_to(collected)
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
        waited_for: set[int] = set()

        def ask(agent: int) -> None:
            # A robot that has not come yet will hear of the wanted rounds when it does. One that has, but of whose
            # round nothing has come, may just be slow; or it sent the round to a data center that died, or while this
            # one was cut off, and will not send it again unasked.
            if self._stages[agent] >= 0:
                if agent in waited_for or self._rounds.has_of(agent, round_):
                    topic = topics.collect_again(self._run, self._arm, self._training[agent], agent)
                    self._bus.publish(topic, encode_json(RoundRequest(first=round_, last=round_)))
                waited_for.add(agent)

        self._listener.until_none_is(self._missing, f"round {round_} of robots {{}}", ask)
        arrived = self._rounds.take()
        return {
            task: [arrived[agent] for agent in agents if agent in arrived]
            for task, agents in self._scenario.training_agents.items()
        }

    def robots_that_missed_a_model(self) -> list[tuple[str, int]] | None:
        """(arm, robot) of those that ask for a meta-model again; None once every robot has begun to adapt it."""
        self._listener.until(
            lambda: bool(self._asked_for_model) or self.all_reached(self._ready),
            lambda: f"robots {self.behind(self._ready)} to take the meta-model",
            whom=lambda: clients_of(self.behind(self._ready)),
        )
        asked, self._asked_for_model = self._asked_for_model, {}
        return list(asked) or None

    def _missing(self) -> list[int]:
        round_, missing = self._rounds.done + 1, self._rounds.missing()
        for agent in missing:
            if self._stages[agent] >= self._ready:
                here = f"round {round_} of it"
                raise left_behind(f"robot {agent}", "past meta-learning", "the data center", here, self._run)
        # A task that nothing has ever been heard of cannot be learned: that first round is waited for.
        return [agent for agent in missing if round_ == 1 or not self.is_left_out(agent)]

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
        if not self._rounds.put(header.round, header.agent, read, header.motion):
            self.repeated(message)
