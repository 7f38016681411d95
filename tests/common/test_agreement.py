"""All processes of a run have one scenario, over the in-memory bus."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.bus.agreement import Agreement, Proclamation, differences, proclamation, terms
from jouleswarm.common.bus.bus import MemoryHub, Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import decode_json

TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"
RUN = "r"
SHARED, RECORDERS = topics.scenario(RUN, "all"), topics.scenario(RUN, "recorder")
PATIENT_S = 60.0


def toy(*overrides: str) -> Scenario:
    return load_scenario(TOY, overrides)


class Process:
    def __init__(self, hub: MemoryHub, name: str, *overrides: str) -> None:
        self.bus = hub.connect(name)
        self.listener = Listener(self.bus, PATIENT_S)
        self.agreement = Agreement(self.listener, toy(*overrides), RUN)

    def settle(self) -> Process:
        self.agreement.settle()
        return self

    def refused(self) -> str:
        with pytest.raises(ConfigurationError) as caught:
            self.agreement.settle()
        assert "\n" not in str(caught.value)
        return str(caught.value)


def retained(hub: MemoryHub, topic: str) -> dict[str, Any] | None:
    late = hub.connect("late")
    late.subscribe(topic)
    message = late.receive(0.001)
    return decode_json(message.payload, Proclamation).terms if message else None


def test_processes_of_one_scenario_agree_whatever_their_prices_names_and_patience() -> None:
    hub = MemoryHub()
    Process(hub, "agent-1").settle()
    Process(hub, "agent-2", "name=other", "energy.pue=1", "bus.resend_after_s=1", "bus.connect_timeout_s=1").settle()
    Process(hub, "datacenter", "bus.keepalive_s=90").settle()


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("seed=7", "seed is 7 here and 1 there"),
        ("learning.lr=0.1", "learning.lr is 0.1 here and 0.001 there"),
        ("bus.qos=0", "bus.qos is 0 here and 1 there"),
        ("energy.beta=measured", 'energy.beta is "measured" here and 1.0 there'),
        ("methods=['fl']", 'methods is ["fl"] here and ["maml", "fl"] there'),
        ("network.dense=[16]", "network.dense is [16] here and [32] there"),
    ],
)
def test_who_comes_with_another_scenario_is_refused_with_both_values(override: str, told: str) -> None:
    hub = MemoryHub()
    first = Process(hub, "agent-1").settle()
    said = Process(hub, "agent-2", override).refused()
    assert f"another scenario than the run's: {told}; expected that of the process that came first" in said
    first.listener.take_waiting()  # it goes on
    Process(hub, "agent-3").settle()


def test_many_differences_are_told_shortly() -> None:
    changes = [f"learning.{name}" for name in ("lr=1", "epsilon=1", "discount=0", "batch_size=1", "replay_size=3")]
    hub = MemoryHub()
    Process(hub, "agent-1").settle()
    said = Process(hub, "agent-2", *changes, "seed=2").refused()
    assert said.count(" here and ") == 5
    assert "; and 1 more; expected" in said


def test_the_recorder_s_scenario_is_the_run_s_whoever_came_first() -> None:
    hub = MemoryHub()
    early = Process(hub, "agent-1", "seed=7").settle()
    hub.connect("recorder").publish(RECORDERS, proclamation(toy()), retain=True)
    with pytest.raises(ConfigurationError, match="seed is 7 here and 1 there; expected the recorder's"):
        early.listener.take_waiting()
    assert "seed is 7 here and 1 there; expected the recorder's" in Process(hub, "agent-2", "seed=7").refused()
    Process(hub, "agent-3").settle()


class Overtaking(MemoryHub):
    """Lets somebody settle just before robot 2's word reaches the broker."""

    overtaker: Process | None = None

    def route(self, client: str, message: Message, qos: int, retain: bool) -> None:
        overtaker = self.overtaker
        if client == "agent-2" and retain and overtaker is not None:
            self.overtaker = None
            overtaker.settle()
        super().route(client, message, qos, retain)


def test_of_two_that_say_theirs_at_once_the_first_in_the_broker_s_order_goes_on() -> None:
    hub = Overtaking()
    hub.overtaker = first = Process(hub, "agent-1")
    assert "seed is 7 here and 1 there" in Process(hub, "agent-2", "seed=7").refused()
    assert retained(hub, SHARED) == terms(toy())  # what the second had overwritten
    first.listener.take_waiting()
    assert retained(hub, SHARED) == terms(toy())


def test_of_two_that_say_the_same_at_once_both_go_on() -> None:
    hub = Overtaking()
    hub.overtaker = first = Process(hub, "agent-1")
    second = Process(hub, "agent-2").settle()
    for process in (first, second):
        process.listener.take_waiting()
        process.agreement.leave()
    assert retained(hub, SHARED) is None


def test_what_a_process_has_said_goes_with_it_and_nothing_of_the_others() -> None:
    hub = MemoryHub()
    first, second = Process(hub, "agent-1").settle(), Process(hub, "agent-2").settle()
    second.agreement.leave()
    assert retained(hub, SHARED) == terms(toy())
    first.agreement.leave()
    assert retained(hub, SHARED) is None
    Process(hub, "agent-3", "seed=7").settle()  # the next run by this name


def test_nothing_of_it_is_metered() -> None:
    hub = MemoryHub()
    Process(hub, "agent-1").settle().agreement.leave()
    assert hub.meter.rows() == []


def test_a_key_that_only_one_side_knows_is_a_difference() -> None:
    assert list(differences({"a.b": 1, "c": 2}, {"c": 2, "d": "x" * 100})) == [
        "a.b is 1 here and not there there",
        f'd is not there here and "{"x" * 56}... there',
    ]


@pytest.mark.parametrize("payload", [b"{", b'{"who": "x"}', b'{"who": 1, "terms": {}}', b"[" * 100_000])
def test_what_is_no_scenario_is_refused_and_ends_nothing(payload: bytes) -> None:
    hub = MemoryHub()
    first = Process(hub, "agent-1").settle()
    hub.connect("stranger").publish(SHARED, payload)
    first.listener.take_waiting()
    assert first.listener.refused == 1
