"""A robot's link to a data center that takes part in every round (fedavg, centralized)."""

from __future__ import annotations

from collections.abc import Callable

from jouleswarm.agents.membership import names
from jouleswarm.agents.peers import Exchange
from jouleswarm.common.bus.bus import Message
from jouleswarm.common.disk.state import State
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Episode, ModelHeader, RoundRequest, decode_json, encode_json
from jouleswarm.common.wire.types import Tensors, Weights

Model = tuple[Weights, ModelHeader]


class ServerLink:
    """Receives the cluster's models; where robots send experience it sends that and hears of others' episodes."""

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange
        self._models: dict[int, tuple[Tensors, ModelHeader]] = {}  # not decoded: that is done in the order of rounds
        self._decoder = exchange.decoder()
        self._taken, self._is_back = 0, False
        self._episodes: dict[int, dict[int, float]] = {}
        self._round = 0
        self._motions: tuple[int, list[bytes]] = (0, [])
        here = exchange.here
        run, arm, task = exchange.run, exchange.arm, here.task
        self._experience_topic = topics.transition(run, arm, task, here.agent)
        self._collect_otherwise = exchange.handlers.get("collect")
        exchange.handlers |= {"model": self._take_model, "episode": self._take_episode, "collect": self._take_collect}
        exchange.subscribe(topics.cluster_model(run, arm, task), qos=exchange.qos)

    def hear_episodes(self) -> None:
        """Listen to the cluster's episodes and to requests for experience, before the first round."""
        here, run, arm = self._exchange.here, self._exchange.run, self._exchange.arm
        others = [each for each in here.cluster if each != here.agent]
        self._exchange.subscribe(
            topics.collect_again(run, arm, here.task, here.agent),
            *(topics.episode(run, arm, here.task, each) for each in others),
        )

    def publish_motion(self, round_: int, payload: bytes) -> None:
        """Send one motion up; the round's motions are kept in case the data center asks again."""
        if self._motions[0] != round_:
            self._motions = (round_, [])
        self._motions[1].append(payload)
        self._exchange.publish(self._experience_topic, payload)

    def await_model(self, round_: int) -> Model:
        """The cluster's model of `round_` from the data center."""
        here, run, arm = self._exchange.here, self._exchange.run, self._exchange.arm
        self._round = round_

        def ask() -> None:
            request = encode_json(RoundRequest(first=round_, last=round_))
            self._exchange.publish(topics.model_again(run, arm, here.task), request)

        what = f"the data center's model of round {round_}"
        self._until(lambda: round_ in self._models, what, ask, lambda: [topics.DATACENTER])
        tensors, header = self._models.pop(round_)
        self._models = {each: kept for each, kept in self._models.items() if each > round_}
        self._taken = round_
        return self._decoder.decode(tensors), header

    def publish_episode(self, episode: Episode) -> None:
        """Tell the cluster and the data center how the robot's greedy episode went."""
        self._exchange.publish_round(episode.round, encode_json(episode))

    def await_episodes(self, round_: int) -> dict[int, float]:
        """The other robots' rewards of `round_`."""
        here, run, arm = self._exchange.here, self._exchange.run, self._exchange.arm
        heard = self._episodes.setdefault(round_, {})

        def missing() -> list[int]:
            return [each for each in here.cluster if each != here.agent and each not in heard]

        def ask() -> None:
            for each in missing():
                request = encode_json(RoundRequest(first=round_, last=round_))
                self._exchange.publish(topics.resend(run, arm, here.task, each), request)

        what = f"episodes of round {round_}"
        self._until(lambda: not missing(), what, ask, lambda: names(missing()))
        return self._episodes.pop(round_)

    def _until(
        self, condition: Callable[[], bool], what: str, ask: Callable[[], None], whom: Callable[[], list[str]]
    ) -> None:
        self._exchange.awaited_round, at_once = self._round, self._is_back and self._exchange.may_have_missed
        self._exchange.until(condition, lambda: what, ask, at_once=at_once, whom=whom)
        self._exchange.awaited_round = 0

    def state(self) -> State:
        """See `common.disk.state.Stateful`."""
        return State.of({"decoder": self._decoder.state(), "link": State(values={"taken": self._taken})})

    def load_state(self, state: State) -> None:
        """See `common.disk.state.Stateful`."""
        self._decoder.load_state(state.part("decoder"))
        self._taken = self._round = state.part("link").values["taken"]
        self._is_back = True

    def _take_model(self, message: Message) -> None:
        if topics.arm_of(message.topic) != self._exchange.arm:
            return
        tensors, header = self._exchange.read(message.payload)
        if header.task != self._exchange.here.task:
            raise PayloadError(f"model of task {header.task}, expected task {self._exchange.here.task}")
        self._check_round(header.round)
        if header.round <= self._taken or header.round in self._models:
            self._exchange.repeated(message)
        else:
            self._models[header.round] = (tensors, header)

    def _take_episode(self, message: Message) -> None:
        episode = decode_json(message.payload, Episode)
        if episode.agent != int(message.topic.split("/")[5]):
            raise PayloadError(f"episode of robot {episode.agent} on {message.topic}")
        if topics.arm_of(message.topic) == self._exchange.arm:
            self._check_round(episode.round)
            self._episodes.setdefault(episode.round, {})[episode.agent] = episode.reward

    def _check_round(self, round_: int) -> None:
        # Nobody gets ahead of a robot that has not said its word, so that what is kept here stays bounded.
        if round_ > self._round + 1:
            raise PayloadError(f"round {round_}, expected at most {self._round + 1}")

    def _take_collect(self, message: Message) -> None:
        if topics.arm_of(message.topic) != self._exchange.arm:  # another arm's data center asks
            if self._collect_otherwise is not None:
                self._collect_otherwise(message)
        elif decode_json(message.payload, RoundRequest).first == self._motions[0]:
            for payload in self._motions[1]:
                self._exchange.publish(self._experience_topic, payload)
