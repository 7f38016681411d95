"""The robot process, to be read from top to bottom.

For each arm: take part in the data center's meta-learning (once a method), then learn the task with the neighbours:
collect -> learn -> evaluate -> share -> decide -> mix -> remember, round by round.
"""

from __future__ import annotations

import logging
import time

from jouleswarm.agents.centralized import follow
from jouleswarm.agents.explorer import Explorer
from jouleswarm.agents.memory import Memory
from jouleswarm.agents.meta_stage import MetaLink
from jouleswarm.agents.neighbourhood import neighbourhood_of
from jouleswarm.agents.peers import Exchange
from jouleswarm.agents.sharing import sharing_of
from jouleswarm.common.bus.bus import Bus
from jouleswarm.common.disk.state import NOTHING, Keep, Stateful
from jouleswarm.common.scenario.arms import META_METHODS, SERVED_METHODS, Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.seeding import integer, stream
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.rows import RoundRow, measured
from jouleswarm.common.wire.saved_models import encode_saved_model
from jouleswarm.learning.heads import head_of, meta_shapes, start_of
from jouleswarm.learning.learner import Learner, Weights
from jouleswarm.learning.networks import build_qnetwork, shapes_of, to_weights, use_of
from jouleswarm.methods.ledger import RewardLedger

log = logging.getLogger("jouleswarm.agent")


def run_agent(scenario: Scenario, agent: int, run: str, bus: Bus, keep: Keep = NOTHING) -> None:
    """Live the whole life of robot `agent` on a connected bus; with a folder to `keep` go on from where one was killed.

    Raises:
        ConfigurationError: another process is this robot, or the run has another scenario.
        RunError: the folder holds another robot's or scenario's state, lacks what the others are further with, or who
            is waited for does not come.
        TrainingError: a loss is not finite.
    """
    robot = Robot(scenario, agent, run, bus, keep)
    exchange, memory = robot.exchange, robot.memory
    exchange.claim()
    exchange.agree(scenario)
    done = 2 * len(scenario.arms) + 1
    if memory.is_done:
        log.warning("robot %d of run %s: %s", agent, run, memory.done_line)
        exchange.announce(0)
    else:
        live(robot)
        memory.finish()
        exchange.see_off(done)
    exchange.hand_over(done, stay=not keep.at_the_end and keep.folder is not None)
    memory.clear()
    exchange.leave()


def live(robot: Robot) -> None:
    """All arms of the scenario, or those that are left."""
    scenario, exchange, memory = robot.scenario, robot.exchange, robot.memory
    robot.meta.listen(scenario.arms)
    exchange.join(scenario.arms)
    for index, arm in enumerate(scenario.arms):
        if memory.is_past(arm.name, scenario.arm_names):
            continue
        weights = memory.start_of(arm.name)
        if weights is None:
            weights = robot.meta_learn(arm) if arm.method in META_METHODS else robot.initial_weights()
            memory.begin(arm.name, weights)
        exchange.open_arm(arm, neighbourhood_of(scenario, robot.agent, arm.method), 2 * index + 2)
        if not memory.has_ended(arm.name):
            exchange.announce(2 * index + 1)
            exchange.await_stage(2 * index + 1)
            if arm.method in SERVED_METHODS:
                exchange.await_datacenter(2 * index + 1)
            learn = robot.follow if arm.method == "centralized" else robot.federate
            learn(arm, weights or robot.initial_weights())
        else:
            memory.restore(arm.name, {"exchange": exchange})
        # Neighbours may still ask for the last round's weights again.
        exchange.announce(2 * index + 2)
        exchange.await_stage(2 * index + 2)


class Robot:
    """One robot's state that outlives an arm."""

    def __init__(self, scenario: Scenario, agent: int, run: str, bus: Bus, keep: Keep) -> None:
        self.scenario, self.agent = scenario, agent
        here = neighbourhood_of(scenario, agent)
        self.task = here.task
        self.explorer = Explorer(scenario, agent)
        self.memory = Memory(scenario, agent, run, keep, bus.meter)
        network, settings = build_qnetwork(scenario), scenario.meta
        shapes, tasks = shapes_of(network), settings.training_tasks if settings.heads == "per_task" else ()
        self.exchange = Exchange(bus, run, here, shapes, scenario.bus, scenario.federation, self.memory.rows)
        self.meta = MetaLink(self.exchange, meta_shapes(shapes, head_of(network), tasks))
        self._sent: dict[str, set[int]] = {}
        self._meter = bus.meter

    def initial_weights(self) -> Weights:
        """Random weights, the same for all robots of a cluster, as federated averaging needs."""
        seed = integer(self.scenario.seed, "initial weights", self.task)
        return to_weights(build_qnetwork(self.scenario, seed))

    def meta_learn(self, arm: Arm) -> Weights:
        """Send experience up while the data center asks for it; return the meta-model that `arm` starts from."""
        method, t0 = arm.method, self.scenario.meta.t0
        sent = self._sent.setdefault(method, set())
        self.explorer.tally = self._meter.tally("maml", method, self.task)
        if self.agent in self.scenario.training_agents.get(self.task, ()):
            while rounds := self.meta.await_rounds_due(method, sent, t0):
                for round_ in rounds:
                    begun = time.monotonic()
                    for payload in self.explorer.motions(round_):
                        self.meta.publish_motion(method, payload)
                    sent.add(round_)
                    self.exchange.report(self._row("maml", method, round_, begun))
        return start_of(self.meta.await_model(arm, t0), self.task)

    def federate(self, arm: Arm, weights: Weights) -> None:
        """Federated learning, eq. (6), until the cluster's R reaches the target."""
        scenario, settings, here = self.scenario, self.scenario.federation, self.exchange.here
        rng = stream(scenario.seed, arm.name, "learn", self.agent)
        tally = self.explorer.tally = self._meter.tally("fl", arm.name, self.task)
        network = build_qnetwork(scenario)
        learner = Learner(network, scenario.learning, weights, rng, self.memory.frames, tally)
        sharing = sharing_of(arm, self.exchange, scenario, len(here.neighbours))
        may_miss = settings.on_missing == "proceed"
        ledger = RewardLedger(here.cluster, here.diameter, settings.reward_window, may_miss=may_miss)
        self.explorer.begin(arm.name, here.cluster)
        kept: dict[str, Stateful] = {
            "learner": learner,
            "explorer": self.explorer,
            "ledger": ledger,
            "sharing": sharing,
            "exchange": self.exchange,
        }
        round_ = self.memory.restore(arm.name, kept)
        while True:
            round_ += 1
            begun = time.monotonic()
            samples = self.explorer.collect(learner, scenario.learning.motions_per_round)
            gradients = learner.learn(scenario.learning.batches_per_round)
            reward, measures = self.explorer.evaluate(learner)

            ledger.record(self.agent, round_, reward)
            mine = learner.weights()
            running = ledger.running_reward(self.agent, round_)
            header = ModelHeader(
                task=self.task, agent=self.agent, round=round_, reward=running, samples=samples, rewards=ledger.newest()
            )
            for theirs in sharing.share(mine, header):
                ledger.merge(theirs.rewards)
            cluster_reward = ledger.cluster_reward(round_)
            learned = cluster_reward is not None and cluster_reward >= settings.target_reward
            last = learned or round_ >= settings.max_rounds
            if not last:
                learner.set_weights(sharing.mixed(mine))

            row = self._row("fl", arm.name, round_, begun).model_copy(
                update={
                    "reward": reward,
                    "cluster_reward": cluster_reward,
                    **measured(measures),
                    "gradients": gradients,
                    "learned": learned if last else None,
                    "missed": self.exchange.missed,
                }
            )
            self.exchange.report(row)
            if last:
                break
            if self.exchange.ahead:
                round_ = min(self.exchange.ahead, settings.max_rounds - 1)
                learner.set_weights(self.exchange.catch_up())
            self.memory.save(arm.name, round_, kept)
        if self.agent == min({*scenario.cluster(self.task)}.difference(self.exchange.missed)):
            self.exchange.hand_in(encode_saved_model(mine, header, use_of(scenario), self.explorer.evaluation))
        self.memory.save(arm.name, round_, {"exchange": self.exchange}, ended=True)

    def follow(self, arm: Arm, weights: Weights) -> None:
        """Centralized learning: act by the data center's model."""
        self.explorer.tally = self._meter.tally("fl", arm.name, self.task)
        follow(self.scenario, arm, weights, self.exchange, self.explorer, self.memory)

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
