"""The robot process, to be read from top to bottom.

For each arm: take part in the meta-learning stage (arm maml), then learn the task with the neighbours:
collect -> learn -> evaluate -> publish -> gather -> decide -> mix, round by round.
"""

from __future__ import annotations

import time

from agents.consensus import Weights, default_step, mix, mixing_weights
from agents.exchange import Exchange
from agents.explorer import Explorer
from agents.learner import Learner
from agents.neighbourhood import RewardLedger, neighbourhood_of
from common.bus import Bus
from common.payloads import ModelHeader
from common.qnetwork import build_qnetwork, shapes_of, to_weights
from common.runlog import RoundRow
from common.scenario import Scenario
from common.seeding import integer, stream


def run_agent(scenario: Scenario, agent: int, run: str, bus: Bus) -> None:
    """Live the whole life of robot `agent` on a connected bus."""
    robot = Robot(scenario, agent, run, bus)
    robot.exchange.join(arm="maml")
    for index, arm in enumerate(scenario.arms):
        weights = robot.meta_learn(arm) if arm == "maml" else robot.initial_weights()
        robot.exchange.open_arm(arm)
        robot.exchange.announce(2 * index + 1)
        robot.exchange.await_stage(2 * index + 1)
        robot.federate(arm, weights)
        # Neighbours may still ask for the last round's weights again.
        robot.exchange.announce(2 * index + 2)
        robot.exchange.await_stage(2 * index + 2)
    robot.exchange.leave()


class Robot:
    """One robot's state that outlives an arm."""

    def __init__(self, scenario: Scenario, agent: int, run: str, bus: Bus) -> None:
        self.scenario, self.agent = scenario, agent
        self.here = neighbourhood_of(scenario, agent)
        self.task = self.here.task
        self.explorer = Explorer(scenario, agent)
        shapes = shapes_of(build_qnetwork(scenario.network))
        self.exchange = Exchange(bus, run, self.here, shapes, scenario.bus.qos, scenario.bus.resend_after_s)

    def initial_weights(self) -> Weights:
        """Random weights, the same for all robots of a cluster, as federated averaging needs."""
        seed = integer(self.scenario.seed, "initial weights", self.task)
        return to_weights(build_qnetwork(self.scenario.network, seed))

    def meta_learn(self, arm: str) -> Weights:
        """Send experience up while the data center asks for it; return the meta-model."""
        t0 = self.scenario.meta.t0
        sent: set[int] = set()
        if self.agent in self.scenario.training_agents.get(self.task, ()):
            while rounds := self.exchange.await_rounds_due(sent, t0):
                for round_ in rounds:
                    begun = time.monotonic()
                    for payload in self.explorer.motions(round_):
                        self.exchange.publish_motion(arm, payload)
                    sent.add(round_)
                    self.exchange.report(self._row("maml", arm, round_, begun))
        return self.exchange.await_meta_model(arm, t0)

    def federate(self, arm: str, weights: Weights) -> None:
        """Decentralized federated learning, eq. (6), until the cluster's R reaches the target."""
        scenario, settings = self.scenario, self.scenario.federation
        step = settings.step or default_step(len(self.here.neighbours))
        learner = Learner(scenario.network, scenario.learning, weights, stream(scenario.seed, arm, "learn", self.agent))
        ledger = RewardLedger(self.here, settings.reward_window)
        self.explorer.begin(arm)
        for round_ in range(1, settings.max_rounds + 1):
            begun = time.monotonic()
            samples = self.explorer.collect(learner, scenario.learning.motions_per_round)
            gradients = learner.learn(scenario.learning.batches_per_round)
            reward, rmse_m = self.explorer.evaluate(learner)

            ledger.record(self.agent, round_, reward)
            mine = learner.weights()
            running = ledger.running_reward(self.agent, round_)
            header = ModelHeader(
                task=self.task, agent=self.agent, round=round_, reward=running, samples=samples, rewards=ledger.newest()
            )
            payload = self.exchange.publish_weights(mine, header)
            arrived = self.exchange.gather(round_)

            for _, theirs in arrived.values():
                ledger.merge(theirs.rewards)
            cluster_reward = ledger.cluster_reward(round_)
            learned = cluster_reward is not None and cluster_reward >= settings.target_reward
            last = learned or round_ == settings.max_rounds
            if arrived and not last:
                sigma = mixing_weights({each: theirs.samples for each, (_, theirs) in arrived.items()})
                others = {each: weights for each, (weights, _) in arrived.items()}
                learner.set_weights(mix(mine, others, sigma, step))

            row = self._row("fl", arm, round_, begun).model_copy(
                update={
                    "reward": reward,
                    "cluster_reward": cluster_reward,
                    "rmse_m": rmse_m,
                    "gradients": gradients,
                    "learned": learned if last else None,
                }
            )
            self.exchange.report(row)
            if last:
                break
        if self.here.is_lead:
            self.exchange.hand_in(payload)

    def _row(self, phase: str, arm: str, round_: int, begun: float) -> RoundRow:
        return RoundRow.model_validate(
            {
                "phase": phase,
                "arm": arm,
                "task": self.task,
                "agent": self.agent,
                "round": round_,
                "refused": self.exchange.refused,
                "seconds": round(time.monotonic() - begun, 4),
            }
        )
