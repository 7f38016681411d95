"""Whole rounds of clusters, whichever is complete first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.bus.patience import left_behind
from jouleswarm.common.bus.rounds import Rounds
from jouleswarm.common.disk.state import State, Stateful
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import RoundRequest, Wait, decode_json, encode_json
from jouleswarm.common.wire.names import client_of, clients_of
from jouleswarm.common.wire.types import Payload
from jouleswarm.datacenter.inbox import Desk

T = TypeVar("T")


@dataclass(frozen=True)
class Turn(Generic[T]):
    """A cluster's round, all of it, by robot."""

    task: int
    round: int
    arrived: dict[int, T]


class Service(Protocol[T]):
    """What a method does with a cluster's round."""

    word: str
    """Last level of the uplink topic that robots send on: weights or transition."""

    def messages(self, agent: int) -> int:
        """How many a robot sends in a round."""

    def read(self, payload: Payload, task: int, agent: int) -> tuple[int, int, Any]:
        """(round, place in the round, content) of a message; raises PayloadError."""

    def opened(self, agent: int, contents: list[Any]) -> T:
        """What a robot's messages of a round come to, in the order of rounds; raises PayloadError."""

    def model(self, turn: Turn[T]) -> tuple[bytes, int]:
        """The payload for the cluster, and the batch gradients that it took."""

    def kept(self, task: int) -> Mapping[str, Stateful]:
        """What is kept of one task after a turn."""


class ClusterDesk(Desk, Generic[T]):
    """Collects what each robot sends in a round.

    Robots decide by themselves when their task is learned; a robot that has come as far as stage `done` is.
    """

    def __init__(
        self, listener: Listener, scenario: Scenario, run: str, arm: str, service: Service[T], done: int
    ) -> None:
        super().__init__(listener, scenario, run, arm)
        self._done, self._word, self._read = done, service.word, service.read
        self._rounds: dict[int, Rounds[T]] = {
            task: Rounds(cluster, service.opened, listener.refuse, service.messages)
            for task, cluster in scenario.clusters.items()
        }
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
            lambda: ", ".join(f"round {self._round(task)} of robots {self._awaited(task)}" for task in self._open()),
            self._ask_for_missing,
            at_once=self._asked_on != self._bus.connections,  # what was sent meanwhile, or before, has not come
            whom=lambda: clients_of(each for task in self._open() for each in self._awaited(task)),
        )
        self._asked_on = self._bus.connections
        task = None if self.all_reached(self._done) else self._complete()
        return None if task is None else Turn(task, self._round(task), self._rounds[task].take())

    def state(self, task: int) -> State:
        """A cluster's: its rounds done, and the last answer for who asks again."""
        round_, payload = self._answers[task]
        return State({"answer": np.frombuffer(payload, np.uint8)}, {"round": round_})

    def load_state(self, task: int, state: State, *, may_have_missed: bool = True) -> None:
        """Take up what `state` returned; what was said meanwhile, if anything may have been, is asked for at once."""
        self._answers[task] = state.values["round"], state.arrays["answer"].tobytes()
        self._rounds[task].go_to(state.values["round"])
        self._asked_on = -1 if may_have_missed else self._asked_on

    def answer(self, turn: Turn[T], payload: bytes) -> None:
        """The model of a cluster's round; kept until the next one in case somebody asks again. `send` sends it."""
        self._answers[turn.task] = (turn.round, payload)
        self._rounds[turn.task].go_to(turn.round)

    def send(self, task: int) -> None:
        """Send a cluster its newest model."""
        self._publish(task, self._answers[task][1])

    def take(self, message: Message) -> None:
        *_, task, agent, word = message.topic.split("/")
        if word == self._word:
            round_, place, content = self._read(message.payload, int(task), int(agent))
            if not self._rounds[int(task)].put(round_, int(agent), content, place):
                self.repeated(message)
        elif word == "again":
            round_, payload = self._answers.get(int(task), (0, b""))
            if decode_json(message.payload, RoundRequest).first == round_:
                self._publish(int(task), payload)
        else:
            super().take(message)

    def _round(self, task: int) -> int:
        """That a cluster is waited for with."""
        return self._rounds[task].done + 1

    def _complete(self) -> int | None:
        """A cluster all of whose round has come."""
        return next((task for task, rounds in self._rounds.items() if not rounds.missing()), None)

    def _open(self) -> list[int]:
        """Clusters that somebody is waited for of."""
        return [task for task in self._rounds if self._awaited(task)]

    def _awaited(self, task: int) -> list[int]:
        """Robots of a cluster that are to send its round, or to say that they are done."""
        return [agent for agent in self._rounds[task].missing() if self._stages[agent] < self._done]

    def _done_rounds(self, client: str) -> int:
        robots = {client_of(agent): task for task in self._rounds for agent in self._scenario.cluster(task)}
        return self._rounds[robots[client]].done if client in robots else 0

    def place(self, client: str) -> tuple[int, int]:
        return self._done - 1, self._done_rounds(client)

    def told(self, wait: Wait) -> None:
        # A robot gets no further than a round without this data center.
        if wait.stage == self._done - 1 and wait.round > self._done_rounds(wait.client) + 2:
            there, here = f"in round {wait.round} of {self._arm}", f"{self._done_rounds(wait.client)} rounds of it"
            raise left_behind(wait.client, there, "the data center", here, self._run)

    def _ask_for_missing(self) -> None:
        again = topics.resend if self._word == "weights" else topics.collect_again
        for task in self._open():
            request = encode_json(RoundRequest(first=self._round(task), last=self._round(task)))
            for agent in self._awaited(task):
                if self._stages[agent] >= 0:  # one that has not come yet needs no reminder
                    self._bus.publish(again(self._run, self._arm, task, agent), request)

    def _publish(self, task: int, payload: bytes) -> None:
        topic = topics.cluster_model(self._run, self._arm, task)
        self._bus.publish(topic, payload, qos=self._scenario.bus.qos)
