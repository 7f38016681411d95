"""Whole rounds of clusters, whichever is complete first."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from common import topics
from common.bus import Message, Payload
from common.errors import PayloadError
from common.listener import Listener
from common.payloads import RoundRequest, decode_json, encode_json
from common.scenario import Scenario
from common.state import State
from datacenter.desk import Desk, log

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
    """Last level of the uplink topic that robots send on: weights or experience."""
    per_robot: int
    """Messages that each robot sends a round."""

    def read(self, payload: Payload, task: int, agent: int) -> tuple[int, int, T]:
        """(round, place in the round, content) of a message; raises PayloadError."""

    def model(self, turn: Turn[T]) -> tuple[bytes, int]:
        """The payload for the cluster, and the batch gradients that it took."""

    def state(self, task: int) -> State:
        """Of one task, after a turn (see `common.state.Stateful`)."""

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
        self._done, self._word, self._per_robot, self._read = done, service.word, service.per_robot, service.read
        self._rounds = dict.fromkeys(scenario.clusters, 1)
        self._arrived: dict[tuple[int, int, int], dict[int, T]] = {}  # (task, round, robot) -> place -> content
        self._answers: dict[int, tuple[int, bytes]] = {}
        self._quiet_from, self._asked_on = time.monotonic(), self._bus.connections
        up = topics.weights_up if self._word == "weights" else topics.experience
        self.subscriptions += [
            *(up(run, arm, task, agent) for task, cluster in scenario.clusters.items() for agent in cluster),
            *(topics.model_again(run, arm, task) for task in scenario.clusters),
        ]

    def next_round(self) -> Turn[T] | None:
        """The next cluster's round that is complete; None once every robot is done."""
        while not self.all_reached(self._done):
            for task in self._rounds:
                if not self._missing(task):
                    return self._turn(task)
            self._wait()
        return None

    def state(self, task: int) -> State:
        """A cluster's: its rounds done, and the last answer for who asks again."""
        round_, payload = self._answers[task]
        return State({"answer": np.frombuffer(payload, np.uint8)}, {"round": round_})

    def load_state(self, task: int, state: State) -> None:
        """Take up what `state` returned."""
        self._answers[task] = state.values["round"], state.arrays["answer"].tobytes()
        self._rounds[task] = state.values["round"] + 1
        self._asked_on = -1  # ask at once

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
        if not self._rounds[task] <= round_ <= self._rounds[task] + 1 or not 0 <= place < self._per_robot:
            if round_ < self._rounds[task]:
                return False
            raise PayloadError(
                f"round {round_}, message {place} of robot {agent}; expected round {self._rounds[task]} "
                f"and messages below {self._per_robot}"
            )
        arrived = self._arrived.setdefault((task, round_, agent), {})
        is_new = place not in arrived
        if is_new:
            arrived[place] = content
        self._quiet_from = time.monotonic()
        return is_new

    def _turn(self, task: int) -> Turn[T]:
        round_ = self._rounds[task]
        arrived = {agent: self._arrived.pop((task, round_, agent)) for agent in self._scenario.cluster(task)}
        return Turn(
            task, round_, {agent: [parts[place] for place in sorted(parts)] for agent, parts in arrived.items()}
        )

    def _missing(self, task: int) -> list[int]:
        round_ = self._rounds[task]
        return [
            agent
            for agent in self._scenario.cluster(task)
            if len(self._arrived.get((task, round_, agent), {})) < self._per_robot
        ]

    def _wait(self) -> None:
        wait_s = self._scenario.bus.resend_after_s
        connections = self._bus.connections
        self._listener.take_next(wait_s if self._asked_on == connections else 0)
        # What was sent while the connection was lost, or before this process was there, has not come.
        if self._asked_on == connections and time.monotonic() - self._quiet_from < wait_s:
            return
        self._quiet_from, self._asked_on = time.monotonic(), connections
        for task in self._rounds:
            for agent in self._missing(task):
                if 0 <= self._stages[agent] < self._done:  # one that has not come yet needs no reminder
                    log.info("waiting for round %d of robot %d", self._rounds[task], agent)
                    self._ask_again(task, agent)

    def _ask_again(self, task: int, agent: int) -> None:
        again = topics.resend if self._word == "weights" else topics.collect_again
        request = RoundRequest(first=self._rounds[task], last=self._rounds[task])
        self._bus.publish(again(self._run, self._arm, task, agent), encode_json(request))

    def _publish(self, task: int, payload: bytes) -> None:
        topic = topics.cluster_model(self._run, self._arm, task)
        self._bus.publish(topic, payload, qos=self._scenario.bus.qos)
