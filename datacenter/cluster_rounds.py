"""Whole rounds of clusters, whichever is complete first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.disk.state import State
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import RoundRequest, Wait, decode_json, encode_json
from jouleswarm.common.wire.types import Payload
from jouleswarm.datacenter.inbox import Desk, names

T = TypeVar("T")


@dataclass(frozen=True)
class Turn(Generic[T]):
    """A cluster's round, all of it: robot -> its contents in order."""

    task: int
    round: int
    arrived: dict[int, list[T]]


class Service(Protocol[T]):
    """What a method does with a cluster's round."""

    word: str
    """Last level of the uplink topic that robots send on: weights or transition."""

    def messages(self, agent: int) -> int:
        """How many a robot sends in a round."""

    def read(self, payload: Payload, task: int, agent: int) -> tuple[int, int, T]:
        """(round, place in the round, content) of a message; raises PayloadError."""

    def model(self, turn: Turn[T]) -> tuple[bytes, int]:
        """The payload for the cluster, and the batch gradients that it took."""

    def state(self, task: int) -> State:
        """Of one task, after a turn (see `common.disk.state.Stateful`)."""

    def load_state(self, task: int, state: State) -> None:
        """Take up what `state` returned."""


class ClusterDesk(Desk, Generic[T]):
    """Collects what each robot sends in a round.

    Robots decide by themselves when their task is learned; a robot that has come as far as stage `done` is.
    """

    def __init__(
        self, listener: Listener, scenario: Scenario, run: str, arm: str, service: Service[T], done: int
    ) -> None:
        super().__init__(listener, scenario, run, arm)
        self._done, self._word, self._per_robot, self._read = done, service.word, service.messages, service.read
        self._rounds = dict.fromkeys(scenario.clusters, 1)
        self._arrived: dict[tuple[int, int, int], dict[int, T]] = {}  # (task, round, robot) -> place -> content
        self._answers: dict[int, tuple[int, bytes]] = {}
        self._asked_on = self._bus.connections
        up = topics.weights_up if self._word == "weights" else topics.transition
        self.subscriptions += [
            *(up(run, arm, task, agent) for task, cluster in scenario.clusters.items() for agent in cluster),
            *(topics.model_again(run, arm, task) for task in scenario.clusters),
        ]

    def next_round(self) -> Turn[T] | None:
        """The next cluster's round that is complete; None once every robot is done."""
        self._listener.until(
            lambda: self.all_reached(self._done) or self._complete() is not None,
            lambda: ", ".join(f"round {self._rounds[task]} of robots {self._awaited(task)}" for task in self._open()),
            self._ask_for_missing,
            at_once=self._asked_on != self._bus.connections,  # what was sent meanwhile, or before, has not come
            whom=lambda: names(each for task in self._open() for each in self._awaited(task)),
        )
        self._asked_on = self._bus.connections
        task = None if self.all_reached(self._done) else self._complete()
        return None if task is None else self._turn(task)

    def state(self, task: int) -> State:
        """A cluster's: its rounds done, and the last answer for who asks again."""
        round_, payload = self._answers[task]
        return State({"answer": np.frombuffer(payload, np.uint8)}, {"round": round_})

    def load_state(self, task: int, state: State, *, may_have_missed: bool = True) -> None:
        """Take up what `state` returned; what was said meanwhile, if anything may have been, is asked for at once."""
        self._answers[task] = state.values["round"], state.arrays["answer"].tobytes()
        self._rounds[task] = state.values["round"] + 1
        self._asked_on = -1 if may_have_missed else self._asked_on

    def answer(self, turn: Turn[T], payload: bytes) -> None:
        """The model of a cluster's round; kept until the next one in case somebody asks again. `send` sends it."""
        self._answers[turn.task] = (turn.round, payload)
        self._rounds[turn.task] += 1

    def send(self, task: int) -> None:
        """Send a cluster its newest model."""
        self._publish(task, self._answers[task][1])

    def take(self, message: Message) -> None:
        *_, task, agent, word = message.topic.split("/")
        if word == self._word:
            round_, place, content = self._read(message.payload, int(task), int(agent))
            if not self._keep(int(task), round_, int(agent), place, content):
                self.repeated(message)
        elif word == "again":
            round_, payload = self._answers.get(int(task), (0, b""))
            if decode_json(message.payload, RoundRequest).first == round_:
                self._publish(int(task), payload)
        else:
            super().take(message)

    def _keep(self, task: int, round_: int, agent: int, place: int, content: T) -> bool:
        """Whether it is new."""
        # A robot is never more than a round ahead of its cluster; older rounds are duplicates.
        if not self._rounds[task] <= round_ <= self._rounds[task] + 1 or not 0 <= place < self._per_robot(agent):
            if round_ < self._rounds[task]:
                return False
            raise PayloadError(
                f"round {round_}, message {place} of robot {agent}; expected round {self._rounds[task]} "
                f"and messages below {self._per_robot(agent)}"
            )
        arrived = self._arrived.setdefault((task, round_, agent), {})
        is_new = place not in arrived
        if is_new:
            arrived[place] = content
        return is_new

    def _turn(self, task: int) -> Turn[T]:
        round_ = self._rounds[task]
        arrived = {agent: self._arrived.pop((task, round_, agent)) for agent in self._scenario.cluster(task)}
        return Turn(
            task, round_, {agent: [parts[place] for place in sorted(parts)] for agent, parts in arrived.items()}
        )

    def _complete(self) -> int | None:
        """A cluster all of whose round has come."""
        return next((task for task in self._rounds if not self._missing(task)), None)

    def _open(self) -> list[int]:
        """Clusters that somebody is waited for of."""
        return [task for task in self._rounds if self._awaited(task)]

    def _awaited(self, task: int) -> list[int]:
        """Robots of a cluster that are to send its round, or to say that they are done."""
        return [agent for agent in self._missing(task) if self._stages[agent] < self._done]

    def _done_rounds(self, client: str) -> int:
        robots = {f"agent-{agent}": task for task in self._rounds for agent in self._scenario.cluster(task)}
        return self._rounds[robots[client]] - 1 if client in robots else 0

    def place(self, client: str) -> tuple[int, int]:
        return self._done - 1, self._done_rounds(client)

    def told(self, wait: Wait) -> None:
        # A robot gets no further than a round without this data center.
        if wait.stage == self._done - 1 and wait.round > self._done_rounds(wait.client) + 2:
            there = f"in round {wait.round} of {self._arm}"
            raise self.left_behind(wait.client, there, f"{self._done_rounds(wait.client)} rounds of it")

    def _missing(self, task: int) -> list[int]:
        round_ = self._rounds[task]
        return [
            agent
            for agent in self._scenario.cluster(task)
            if len(self._arrived.get((task, round_, agent), {})) < self._per_robot(agent)
        ]

    def _ask_for_missing(self) -> None:
        for task in self._open():
            for agent in self._awaited(task):
                if self._stages[agent] >= 0:  # one that has not come yet needs no reminder
                    self._ask_again(task, agent)

    def _ask_again(self, task: int, agent: int) -> None:
        again = topics.resend if self._word == "weights" else topics.collect_again
        request = RoundRequest(first=self._rounds[task], last=self._rounds[task])
        self._bus.publish(again(self._run, self._arm, task, agent), encode_json(request))

    def _publish(self, task: int, payload: bytes) -> None:
        topic = topics.cluster_model(self._run, self._arm, task)
        self._bus.publish(topic, payload, qos=self._scenario.bus.qos)
