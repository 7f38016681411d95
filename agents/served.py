"""A robot's link to a data center that takes part in every round (fedavg, centralized)."""

from __future__ import annotations

from jouleswarm.agents.peers import Exchange
from jouleswarm.common.bus.bus import Message
from jouleswarm.common.disk.state import Stateful, Together
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Episode, ModelHeader, RoundRequest, decode_json
from jouleswarm.common.wire.types import Tensors, Weights
from jouleswarm.methods.method import DATACENTER

Model = tuple[Weights, ModelHeader]


class ServerLink:
    """Receives the cluster's models; where robots send experience it sends that and hears of others' episodes."""

    def __init__(self, exchange: Exchange) -> None:
        self._exchange, here = exchange, exchange.here
        self._decoder = exchange.decoder()
        self._models = exchange.rounds((DATACENTER,), self._decoded)
        others = [each for each in here.cluster if each != here.agent]
        self._episodes = exchange.rounds(others, lambda _, word: float(word[0]))
        self._motions: tuple[int, list[bytes]] = (0, [])
        self._experience_topic = topics.transition(exchange.run, exchange.arm, here.task, here.agent)
        self._collect_otherwise = exchange.handlers.get("collect")
        exchange.handlers |= {"model": self._take_model, "episode": self._take_episode, "collect": self._take_collect}
        exchange.subscribe(topics.cluster_model(exchange.run, exchange.arm, here.task), qos=exchange.qos)

    def hear_episodes(self) -> None:
        """Listen to the cluster's episodes and to requests for experience, before the first round."""
        here, run, arm = self._exchange.here, self._exchange.run, self._exchange.arm
        self._exchange.subscribe(
            topics.collect_again(run, arm, here.task, here.agent),
            *(topics.episode(run, arm, here.task, each) for each in self._episodes.missing()),
        )

    def publish_motion(self, round_: int, payload: bytes) -> None:
        """Send one motion up; the round's motions are kept in case the data center asks again."""
        if self._motions[0] != round_:
            self._motions = (round_, [])
        self._motions[1].append(payload)
        self._exchange.publish(self._experience_topic, payload)

    def await_model(self, round_: int) -> Model:
        """The cluster's model of `round_` from the data center."""

        def again(run: str, arm: str, task: int, _: int) -> str:
            return topics.model_again(run, arm, task)

        self._models.go_to(round_ - 1)
        what = "the data center's model of round {round}"
        self._exchange.await_round(round_, self._models.missing, what, again)
        return self._models.take()[DATACENTER]

    def await_episodes(self, round_: int) -> dict[int, float]:
        """The other robots' rewards of `round_`."""
        self._episodes.go_to(round_ - 1)
        self._exchange.await_round(round_, self._episodes.missing, "episodes of round {round}", topics.resend)
        return self._episodes.take()

    @property
    def kept(self) -> Stateful:
        """What is kept of it after a round."""
        return Together({"decoder": self._decoder, "models": self._models, "episodes": self._episodes})

    def _decoded(self, _: int, word: list[tuple[Tensors, ModelHeader]]) -> Model:
        ((tensors, header),) = word
        return self._decoder.decode(tensors), header

    def _take_model(self, message: Message) -> None:
        if topics.arm_of(message.topic) != self._exchange.arm:
            return
        tensors, header = self._exchange.read(message.payload)
        if header.task != self._exchange.here.task:
            raise PayloadError(f"model of task {header.task}, expected task {self._exchange.here.task}")
        if not self._models.put(header.round, DATACENTER, (tensors, header)):
            self._exchange.repeated(message)

    def _take_episode(self, message: Message) -> None:
        episode = decode_json(message.payload, Episode)
        if episode.agent != int(message.topic.split("/")[5]):
            raise PayloadError(f"episode of robot {episode.agent} on {message.topic}")
        if topics.arm_of(message.topic) == self._exchange.arm:
            self._episodes.put(episode.round, episode.agent, episode.reward)

    def _take_collect(self, message: Message) -> None:
        if topics.arm_of(message.topic) != self._exchange.arm:  # another arm's data center asks
            if self._collect_otherwise is not None:
                self._collect_otherwise(message)
        elif decode_json(message.payload, RoundRequest).first == self._motions[0]:
            for payload in self._motions[1]:
                self._exchange.publish(self._experience_topic, payload)
