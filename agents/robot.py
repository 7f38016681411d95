"""The robot process, to be read from top to bottom.

For each arm: take part in the stage that the data center trains before (once a method), then learn the task with the
method's partners: try the model that they start from, then make transitions and learn -> evaluate -> meet the others ->
decide -> go on -> remember, round by round.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any

from jouleswarm.agents.battery import is_empty
from jouleswarm.agents.explorer import Explorer
from jouleswarm.agents.memory import Memory
from jouleswarm.agents.meta_stage import MetaLink
from jouleswarm.agents.peers import Exchange
from jouleswarm.agents.start import begin
from jouleswarm.agents.ways import Here, Way, way_of
from jouleswarm.codecs.codec import codec_of
from jouleswarm.common.bus.bus import Bus
from jouleswarm.common.disk.state import NOTHING, Keep, Stateful
from jouleswarm.common.scenario.arms import Arm, method_of
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.rows import RoundRow, measured
from jouleswarm.common.wire.saved_models import encode_saved_model
from jouleswarm.common.wire.types import RowPhase, Weights
from jouleswarm.learning.heads import head_of, meta_shapes, start_of
from jouleswarm.learning.networks import build_qnetwork, shapes_of, use_of
from jouleswarm.learning.start import start_weights
from jouleswarm.methods.graph import neighbourhood_of
from jouleswarm.methods.ledger import RewardLedger
from jouleswarm.methods.method import Method
from jouleswarm.methods.trial import try_learning

log = logging.getLogger("jouleswarm.agent")


def run_agent(scenario: Scenario, agent: int, run: str, bus: Bus, keep: Keep = NOTHING) -> None:
    """Live the whole life of robot `agent` on a connected bus; with a folder to `keep` go on from where one was killed.

    Raises:
        ConfigurationError: another process is this robot, or the run has another scenario.
        RunError: the folder holds another robot's or scenario's state, lacks what the others are further with, or who
            is waited for does not come.
        TrainingError: a loss is not finite, or what a method returns is no model.
    """
    bus.meter.measure(scenario.measure)
    robot = Robot(scenario, agent, run, bus, keep)
    exchange, memory = robot.exchange, robot.memory
    exchange.claim()
    exchange.agree(scenario)
    done = 2 * len(scenario.arms) + 1
    if memory.is_done and not memory.begin_again(scenario.arm_names):
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
    methods: dict[str, Method] = {arm.name: scenario.method(arm.method) for arm in scenario.arms}
    robot.meta.listen([arm for arm in scenario.arms if methods[arm.name].stage is not None])
    exchange.join(served=any(method.partners == "datacenter" for method in methods.values()))
    for index, arm in enumerate(scenario.arms):
        if memory.is_past(arm.name, scenario.arm_names):
            continue
        method = methods[arm.name]
        weights, end = memory.start_of(arm.name), memory.end_of(arm.name)
        if weights is None and end is None:
            weights = robot.initial_weights() if method.stage is None else robot.meta_learn(arm)
            memory.begin(arm.name, weights)
        here = neighbourhood_of(scenario, robot.agent, method.partners)
        exchange.open_arm(arm, here, 2 * index + 2, word_of(method))
        if not memory.has_ended(arm.name) and not (end is not None and memory.is_over(end)):
            exchange.announce(2 * index + 1)
            exchange.await_stage(2 * index + 1)
            if method.partners == "datacenter":
                exchange.await_datacenter(2 * index + 1)
            robot.learn(arm, method, weights or robot.initial_weights(), end)
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
        network = build_qnetwork(scenario)
        shapes, head = shapes_of(network), head_of(network)
        self.exchange = Exchange(
            bus, run, here, shapes, scenario.bus, scenario.federation, self.memory.rows, codec_of(scenario)
        )
        heads = {name: scenario.method(name).heads(scenario) for name in scenario.meta_methods}
        self.meta = MetaLink(self.exchange, lambda arm: meta_shapes(shapes, head, heads[method_of(arm)]))
        try_learning(scenario)
        self._sent: dict[str, set[int]] = {}
        self._meter = bus.meter

    def initial_weights(self) -> Weights:
        """The same for all robots of a cluster, as federated averaging needs."""
        return start_weights(self.scenario, self.task)

    def meta_learn(self, arm: Arm) -> Weights:
        """Send experience up while the data center asks for it; return the model that `arm` starts from."""
        method, t0 = arm.method, self.scenario.meta.t0
        sent = self._sent.setdefault(method, set())
        self._meter.energy.enter(RowPhase.ML, method)
        self.explorer.tally = self._meter.tally(RowPhase.ML, method, self.task)
        if self.agent in self.scenario.training_agents.get(self.task, ()):
            while rounds := self.meta.await_rounds_due(method, sent, t0):
                for round_ in rounds:
                    begun = time.monotonic()
                    with self._meter.energy.during("learning"):
                        for payload in self.explorer.motions(round_):
                            self.meta.publish_motion(method, payload)
                    sent.add(round_)
                    motions = {"motions": self.scenario.motions(self.agent), "evaluation_motions": 0}
                    self.exchange.report(self._row(RowPhase.ML, method, round_, begun, motions))
        return start_of(self.meta.await_model(arm, t0), self.task)

    def learn(self, arm: Arm, method: Method, weights: Weights, end: RoundRow | None = None) -> None:
        """Learn the task by a method, until the cluster's R reaches the target, be it before the first round.

        `end`: the row that was the last one when there were fewer rounds.
        """
        scenario, settings, exchange = self.scenario, self.scenario.federation, self.exchange
        neighbourhood, energy = exchange.here, self._meter.energy
        energy.enter(RowPhase.FL, arm.name, "start")
        tally = self.explorer.tally = self._meter.tally(RowPhase.FL, arm.name, self.task)
        may_miss = settings.on_missing == "proceed"
        ledger = RewardLedger(neighbourhood.cluster, neighbourhood.diameter, settings.reward_window, may_miss=may_miss)
        here = Here(scenario, self.agent, arm, method, exchange, self.explorer, ledger)
        way = way_of(here, weights, self.memory.frames(arm.name), tally)
        self.explorer.begin(arm.name, neighbourhood.cluster)
        kept: dict[str, Stateful] = {**way.kept, "explorer": self.explorer, "ledger": ledger, "exchange": exchange}
        round_, begun = self.memory.restore(arm.name, kept), time.monotonic()
        exchange.may_have_missed = end is None  # else all go on together
        energy.enter(RowPhase.FL, arm.name)
        if round_:
            exchange.announce_again()
            if end is not None:  # told anew, for it is not the last one any more
                exchange.report(end.model_copy(update={"learned": None}))
            row = self._rounds(here, way, kept, round_)
            model = way.learned(row.round)
        else:
            told, model = begin(here, way, lambda: self.memory.save(arm.name, 0, kept))
            row = self._row("fl", arm.name, 0, begun, told)
            exchange.report(row)
            if not row.learned:
                row = self._rounds(here, way, kept, 0)
                model = way.learned(row.round)
        if self.agent == min({*scenario.cluster(self.task)}.difference(exchange.missed)):
            self._hand_in(*model)
        self.memory.save_end(row, kept)
        self.memory.save(arm.name, row.round, {"exchange": exchange}, ended=True)

    def _rounds(self, here: Here, way: Way, kept: dict[str, Stateful], round_: int) -> RoundRow:
        """The rounds after `round_`; the last one's row."""
        settings, exchange, ledger, arm = self.scenario.federation, self.exchange, here.ledger, here.arm.name
        while True:
            round_ += 1
            begun = time.monotonic()
            with self._meter.energy.during("learning"):
                gradients = way.learn(round_)
                trial = self.explorer.evaluate(way.policy)
            ledger.record(self.agent, round_, trial.reward)
            way.meet(round_)
            cluster_reward = ledger.cluster_reward(round_)
            reached = cluster_reward is not None and cluster_reward >= settings.target_reward
            learned = reached and (settings.window == "partial" or ledger.is_full(round_))
            empty = not learned and is_empty(self.scenario, here.arm, exchange.here, self._meter, round_)
            last = learned or empty or round_ >= settings.max_rounds
            if not last or self.memory.keeps_ends:
                way.go_on()
            told = {
                "reward": trial.reward,
                "cluster_reward": cluster_reward,
                **measured(trial.measures),
                "gradients": gradients,
                "motions": self.scenario.motions(self.agent),
                "evaluation_motions": trial.motions,
                "ran_away": trial.ran_away,
                "learned": learned if last else None,
                "missed": exchange.missed,
            }
            row = self._row("fl", arm, round_, begun, told)
            exchange.report(row)
            if empty:
                log.warning("robot %d: battery empty after round %d of %s", self.agent, round_, arm)
            if last:
                return row
            if exchange.ahead:
                round_ = min(exchange.ahead, settings.max_rounds - 1)
                way.policy.set_weights(exchange.catch_up())
            self.memory.save(arm, round_, kept)

    def _hand_in(self, weights: Weights, header: ModelHeader) -> None:
        use, evaluation = use_of(self.scenario), self.explorer.evaluation
        self.exchange.hand_in(encode_saved_model(weights, header, use, evaluation))

    def _row(self, phase: str, arm: str, round_: int, begun: float, told: dict[str, Any]) -> RoundRow:
        return RoundRow.model_validate(
            {
                "phase": phase,
                "arm": arm,
                "task": self.task,
                "agent": self.agent,
                "round": round_,
                "refused": self.exchange.refused,
                "seconds": round(time.monotonic() - begun, 4),
                **told,
            }
        )


def word_of(method: Method) -> Callable[[str, str, int, int], str]:
    """The topic of a robot's word of a round: its weights, to whom they are for, or how its episode went."""
    if method.sends == "experience":
        return topics.episode
    return topics.weights_up if method.partners == "datacenter" else topics.weights
