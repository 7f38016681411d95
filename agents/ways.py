"""The two ways of a robot's round: it learns and tells its weights, or it moves and sends what it has seen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from jouleswarm.agents.explorer import Explorer
from jouleswarm.agents.partners import Partners
from jouleswarm.agents.peers import Exchange
from jouleswarm.agents.served import ServerLink
from jouleswarm.common.disk.state import Stateful
from jouleswarm.common.meter.work import Tally
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.seeding import stream
from jouleswarm.common.wire.messages import Episode, ModelHeader, encode_json
from jouleswarm.common.wire.types import Weights
from jouleswarm.learning.learner import Learner, Policy
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.methods.ledger import RewardLedger
from jouleswarm.methods.method import Method


@dataclass(frozen=True)
class Here:
    """A robot in an arm."""

    scenario: Scenario
    agent: int
    arm: Arm
    method: Method
    exchange: Exchange
    explorer: Explorer
    ledger: RewardLedger


class Way(Protocol):
    """A round, in three parts; the robot's loop evaluates after the first and decides after the second."""

    policy: Policy
    """What acts."""

    def learn(self, round_: int) -> int:
        """Make this round's transitions and have the policy learn; the batch gradients that the robot computed."""

    def meet(self, round_: int) -> None:
        """Say this robot's word, and hear what others were rewarded, into the ledger."""

    def go_on(self) -> None:
        """Take the model that the next round begins with."""

    def learned(self, round_: int) -> tuple[Weights, ModelHeader]:
        """The round's model as it is handed in."""

    @property
    def kept(self) -> dict[str, Stateful]:
        """What a state is made of, beside the exchange's."""


def way_of(here: Here, weights: Weights, frames: Path | None, tally: Tally) -> Way:
    """The way of the arm's method.

    Args:
        here: the robot in the arm.
        weights: to begin with.
        frames: file for the replay memory's frames.
        tally: of the robot's gradients.
    """
    if here.method.sends == "experience":
        return ByExperience(here, weights)
    return ByWeights(here, weights, frames, tally)


class ByWeights:
    """The robot learns by itself, tells its weights, and mixes."""

    def __init__(self, here: Here, weights: Weights, frames: Path | None, tally: Tally) -> None:
        scenario, agent = here.scenario, here.agent
        self._here, self._partners = here, Partners(here.exchange, here.method, scenario.federation)
        rng, penalty = stream(scenario.seed, here.arm.name, "learn", agent), here.method.own_penalty
        learning = scenario.learning.model_copy(update={"motions_per_round": scenario.motions(agent)})
        self._learner = Learner(build_qnetwork(scenario), learning, weights, rng, frames, tally, penalty)
        self.policy: Policy = self._learner
        self._samples = 0
        self._mine: Weights = {}
        self._header = ModelHeader(task=0, agent=0, round=0)

    def learn(self, round_: int) -> int:
        here = self._here
        self._samples = here.explorer.collect(self._learner, here.scenario.motions(here.agent))
        return self._learner.learn(here.scenario.batches(here.agent))

    def meet(self, round_: int) -> None:
        here, ledger = self._here, self._here.ledger
        self._mine = self._learner.weights()
        self._header = ModelHeader(
            task=here.exchange.here.task,
            agent=here.agent,
            round=round_,
            reward=ledger.running_reward(here.agent, round_),
            samples=self._samples,
            rewards=ledger.newest(),
        )
        for theirs in self._partners.meet(self._mine, self._header):
            ledger.merge(theirs.rewards)

    def go_on(self) -> None:
        self._learner.set_weights(self._partners.mixed(self._mine))

    def learned(self, round_: int) -> tuple[Weights, ModelHeader]:
        return self._mine, self._header

    @property
    def kept(self) -> dict[str, Stateful]:
        return {"learner": self._learner, "partners": self._partners.kept}


class ByExperience:
    """The data center learns the task from what its robots see; they act by its model and tell how that goes."""

    def __init__(self, here: Here, weights: Weights) -> None:
        self._here, self._link = here, ServerLink(here.exchange)
        self._link.hear_episodes()
        self.policy = Policy(build_qnetwork(here.scenario), weights)

    def learn(self, round_: int) -> int:
        for payload in self._here.explorer.policy_motions(self.policy, round_):
            self._link.publish_motion(round_, payload)
        self.policy.set_weights(self._link.await_model(round_)[0])
        return 0

    def meet(self, round_: int) -> None:
        agent, ledger = self._here.agent, self._here.ledger
        _, reward = ledger.newest()[agent]
        self._here.exchange.publish_round(round_, encode_json(Episode(agent=agent, round=round_, reward=reward)))
        for other, theirs in self._link.await_episodes(round_).items():
            ledger.record(other, round_, theirs)

    def go_on(self) -> None:
        pass  # the model came before it was tried

    def learned(self, round_: int) -> tuple[Weights, ModelHeader]:
        here, ledger = self._here, self._here.ledger
        header = ModelHeader(
            task=here.exchange.here.task,
            agent=here.agent,
            round=round_,
            reward=ledger.cluster_reward(round_),
            rewards=ledger.newest(),
        )
        return self.policy.weights(), header

    @property
    def kept(self) -> dict[str, Stateful]:
        return {"policy": self.policy, "link": self._link.kept, "method": self._here.method}
