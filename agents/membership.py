"""A robot among the others of its run: who it is, where it and they stand, and how it leaves."""

from __future__ import annotations

import logging
from pathlib import Path

from jouleswarm.agents.absence import Absence
from jouleswarm.common.bus.agreement import Agreement
from jouleswarm.common.bus.bus import Bus, Message
from jouleswarm.common.bus.identity import Identity
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.bus.patience import Patience, left_behind
from jouleswarm.common.bus.reporter import Reporter
from jouleswarm.common.errors import PayloadError, RunError
from jouleswarm.common.host import Others, arithmetic
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Bus as BusSettings
from jouleswarm.common.scenario.sections import Federation
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import ModelHeader, Presence, Wait, decode_json
from jouleswarm.common.wire.types import Weights
from jouleswarm.methods.graph import Neighbourhood

log = logging.getLogger("jouleswarm.agent")

Arrived = dict[int, tuple[Weights, ModelHeader]]


class Membership:
    """Robot `agent`'s place in the run. One thread."""

    def __init__(
        self,
        bus: Bus,
        run: str,
        here: Neighbourhood,
        settings: BusSettings,
        federation: Federation,
        rows: Path | None = None,
    ) -> None:
        """`rows`: a file that keeps the rows of a robot that was killed."""
        self._bus, self.run, self.here, self.qos = bus, run, here, settings.qos
        self._absence = Absence(federation)
        self._stages: dict[int, int] = dict.fromkeys(here.neighbours, 0)
        self._hops, self._at_start = here.diameter, dict[int, Presence]()  # the newest that told rewards
        self._datacenter_stage = 0
        self.arm = ""
        self._subscriptions: list[str] = []
        self.awaited_round = 0
        """Of the open arm, that others are waited for; 0: none."""
        self._listener = Listener(bus, settings.resend_after_s, Patience(bus, run, federation.give_up_after_s))
        assert self._listener.patience is not None
        self._listener.patience.place = lambda client: (self._stage, self.newest_round)
        self._listener.patience.told = self._take_answer
        self.until = self._listener.until
        self.handlers = self._listener.handlers
        self.handlers["presence"] = self._take_presence
        processor = arithmetic()
        self._identity = Identity(self._listener, run, here.task, here.agent, settings.keepalive_s, processor)
        self._others = Others(processor)
        self._reporter = Reporter(self._listener, run, rows)
        self._agreement: Agreement | None = None
        self.report, self.announce = self._reporter.row, self._identity.announce

    @property
    def newest_round(self) -> int:
        """The newest round of the open arm that this robot has said something of."""
        return 0

    @property
    def refused(self) -> int:
        """Messages refused so far."""
        return self._listener.refused

    def repeated(self, message: Message) -> None:
        """Book a message that had come before."""
        self._listener.repeated(message, self.qos)

    def claim(self) -> None:
        """Be this robot, and the only one.

        Raises:
            ConfigurationError: another process is it.
        """
        self._identity.claim()
        self._subscriptions += self._identity.filters

    def agree(self, scenario: Scenario) -> None:
        """Have one scenario with all others of the run.

        Raises:
            ConfigurationError: the run has another.
        """
        self._agreement = Agreement(self._listener, scenario, self.run)
        self._agreement.settle()
        self._subscriptions += self._agreement.filters

    def join(self, *, served: bool = False) -> None:
        """Listen to where the neighbours are, and the data center where it serves an arm; then say hello."""
        here, run = self.here, self.run
        self.subscribe(*(topics.presence(run, here.task, each) for each in here.neighbours))
        if served:
            self.subscribe(topics.presence(run, 0, 0))
        self.announce(0)

    def await_datacenter(self, stage: int) -> None:
        """Wait until the data center serves the arm that `stage` opens."""
        condition, what = lambda: self._datacenter_stage >= stage, lambda: "the data center to come"
        self.until(condition, what, whom=lambda: [topics.DATACENTER])

    def await_stage(self, stage: int) -> None:
        """Wait until every neighbour has come as far as `stage`; serves requests meanwhile.

        Raises:
            RunError: one is so far ahead that it has been here with this robot.
        """
        self._absence.begin()

        def behind() -> list[int]:
            for each, reached in self._stages.items():
                self._check_stage(each, reached, stage)
            return self._absence.waited_for([each for each, reached in self._stages.items() if reached < stage])

        self._listener.until_none_is(behind, "robots {} to come")

    @property
    def at_start(self) -> dict[int, float]:
        """Robot -> its reward of round 0 of the open arm, as far as known; told with the presence."""
        return self._identity.rewards

    def announce_again(self) -> None:
        """Tell where this robot stands, with all that it knows of round 0 by now."""
        if len(self.here.cluster) > 1:
            self.announce(self._stage)

    def await_start(self) -> None:
        """Wait until `at_start` has the whole cluster, or all who are waited for.

        It is told with the presence, which stays on the broker: who is late or comes back finds it there. Where not
        everybody hears everybody a robot passes on what it hears.
        """
        known, cluster = self.at_start, self.here.cluster
        self.announce_again()
        self._absence.begin()

        def missing() -> list[int]:
            told = [each for each in self._at_start.values() if (each.stage - 1) // 2 == (self._stage - 1) // 2]
            news = {agent: reward for each in told for agent, reward in each.rewards.items()}
            if news := {agent: reward for agent, reward in news.items() if agent in {*cluster}.difference(known)}:
                known.update(news)
                if self._hops > 1:
                    self.announce_again()
            return self._absence.waited_for([each for each in cluster if each not in known])

        self._listener.until_none_is(missing, "round 0 of robots {}")

    def publish(self, topic: str, payload: bytes, qos: int | None = None) -> None:
        """Send something, at the scenario's QoS unless told otherwise."""
        with self._bus.meter.energy.during("communication"):
            self._bus.publish(topic, payload, qos=self.qos if qos is None else qos)

    def see_off(self, done: int) -> None:
        """Where no recorder keeps in mind who is done, wait until the neighbours know that nobody needs them either.

        One that is killed before it knows comes back, and must find this robot.
        """
        if not self._reporter.has_recorder:
            self.announce(done)
            self.await_stage(done)

    def hand_over(self, done: int, *, stay: bool) -> None:
        """Hand in rows and byte counters, being at stage `done`; `stay`: until the whole run is recorded."""
        if self._agreement is not None:
            self._agreement.leave()
        word = Presence(agent=self.here.agent, stage=done, state="done")
        self._reporter.hand_over(self._subscriptions, self._identity.presence, word, stay=stay)

    def leave(self) -> None:
        """Disconnect."""
        self._reporter.leave(self._identity.presence)

    def subscribe(self, *filters: str, qos: int = 1) -> None:
        """Subscribe until the robot leaves."""
        if filters:
            self._bus.subscribe(*filters, qos=qos)
            self._subscriptions += filters

    def _take_presence(self, message: Message) -> None:
        if not message.payload:
            return
        presence = decode_json(message.payload, Presence)
        if presence.agent != int(message.topic.split("/")[5]):
            raise PayloadError(f"presence of robot {presence.agent}, expected the topic's")
        if presence.agent == self.here.agent:
            self._identity.heard(presence)
        elif presence.state == "gone":
            self._absence.gone(presence.agent)
            name = f"robot {presence.agent}" if presence.agent else "data center"
            does = "going on without it" if self._absence.is_tolerated else "waiting for it to come back"
            log.warning("%s is gone; %s", name, does)
        elif presence.agent == 0:
            self._others.heard(presence)
            self._datacenter_stage = max(self._datacenter_stage, presence.stage)
        elif presence.agent in self._stages:
            self._others.heard(presence)
            self._stages[presence.agent] = max(self._stages[presence.agent], presence.stage)
            if presence.rewards:
                self._at_start[presence.agent] = presence
            self._absence.here(presence.agent)

    @property
    def _stage(self) -> int:
        return self._identity.stage or 0

    def _check_stage(self, agent: int, reached: int, stage: int) -> None:
        # Nobody gets further than one stage ahead of a neighbour.
        if reached > stage + 1 and not self._absence.is_tolerated:
            raise self._left_behind(f"robot {agent}", f"at stage {reached}", f"stage {stage}")

    def _take_answer(self, wait: Wait) -> None:
        # Nor further than two rounds.
        far = wait.round > self.awaited_round + 2 and (wait.stage - 1) // 2 == (self._stage - 1) // 2
        if self.awaited_round and far and not self._absence.is_tolerated:
            raise self._left_behind(wait.client, f"in round {wait.round} of {self.arm}", f"round {self.awaited_round}")

    def _left_behind(self, who: str, there: str, here: str) -> RunError:
        return left_behind(who, there, f"robot {self.here.agent}", here, self.run)
