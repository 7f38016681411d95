"""Two processes cannot be the same robot, over the in-memory bus."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from jouleswarm.common.bus.bus import MemoryBus, MemoryHub, Message
from jouleswarm.common.bus.identity import Identity
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Claim, Presence, decode_json, encode_json

RUN, TASK, ME = "r", 1, 3
PRESENCE, CLAIM = topics.presence(RUN, TASK, ME), topics.claim(RUN, TASK, ME)
DEADLINE_S, PATIENT_S = 20.0, 60.0


class Process:
    """One that would be robot 3."""

    def __init__(self, hub: MemoryHub, name: str = "agent-3", keepalive_s: float = PATIENT_S) -> None:
        self.bus = hub.connect(name)
        self.listener = Listener(self.bus, PATIENT_S)
        self.identity = Identity(self.listener, RUN, TASK, ME, keepalive_s)
        self.listener.handlers["presence"] = self._take_presence

    def _take_presence(self, message: Message) -> None:
        if message.payload:
            self.identity.heard(decode_json(message.payload, Presence))

    def serve(self, ended: threading.Event) -> threading.Thread:
        """Go on with its work, which is to take messages."""

        def work() -> None:
            while not ended.is_set():
                self.listener.take_next(0.01)

        return in_thread(work)


def in_thread(body: Callable[[], None]) -> threading.Thread:
    thread = threading.Thread(target=body, daemon=True)
    thread.start()
    return thread


def joined(thread: threading.Thread) -> None:
    thread.join(DEADLINE_S)
    assert not thread.is_alive()


def retained(hub: MemoryHub) -> Presence | None:
    late = hub.connect("late")
    late.subscribe(PRESENCE)
    message = late.receive(0.001)
    return None if message is None else decode_json(message.payload, Presence)


def say(bus: MemoryBus, state: str, stage: int = 1) -> None:
    presence = Presence.model_validate({"agent": ME, "stage": stage, "state": state})
    bus.publish(PRESENCE, encode_json(presence), retain=True)


def test_who_comes_first_is_the_robot_and_says_nothing_before_it_announces_itself() -> None:
    hub = MemoryHub()
    process = Process(hub)
    process.identity.claim()
    assert retained(hub) is None
    process.identity.announce(2)
    assert retained(hub) == Presence(agent=ME, stage=2)


def test_a_second_process_is_refused_and_the_first_goes_on() -> None:
    hub, ended = MemoryHub(), threading.Event()
    first, second = Process(hub), Process(hub, "agent-3-twin")
    first.identity.claim()
    first.identity.announce(4)
    serving = first.serve(ended)
    with pytest.raises(ConfigurationError, match="robot 3 of this run is another process already, which goes on"):
        second.identity.claim()
    ended.set()
    joined(serving)
    assert retained(hub) == Presence(agent=ME, stage=4)
    while second.bus.receive(0) is not None:
        pass  # the claims that it heard
    rival(first.bus)
    assert second.bus.receive(0) is None  # its bus is closed


def rival(bus: MemoryBus, *, holds: bool = False) -> None:
    """A claim of another process."""
    bus.publish(CLAIM, encode_json(Claim(agent=ME, who="another", holds=holds)))


def heard(bus: MemoryBus) -> Claim:
    message = bus.receive(DEADLINE_S)
    assert message is not None, "nothing was claimed"
    return decode_json(message.payload, Claim)


def claims(bus: MemoryBus) -> list[bool]:
    """What the process has said since: whether each was an answer."""
    said = []
    while message := bus.receive(0.001):
        claim = decode_json(message.payload, Claim)
        if claim.who != "another":
            said.append(claim.holds)
    return said


@pytest.mark.parametrize("earlier", [True, False])
def test_the_first_in_the_brokers_order_is_the_robot_when_both_claim_at_once(earlier: bool) -> None:
    hub = MemoryHub()
    process, other = Process(hub), hub.connect("agent-3-twin")
    other.subscribe(CLAIM)
    publish = process.bus.publish

    def publish_beside_another(topic: str, payload: bytes, **options: bool) -> None:
        process.bus.publish = publish  # type: ignore[method-assign]
        if earlier:
            rival(other)
        publish(topic, payload, **options)
        if not earlier:
            rival(other)

    process.bus.publish = publish_beside_another  # type: ignore[method-assign,assignment]
    if earlier:
        with pytest.raises(ConfigurationError):
            process.identity.claim()
        assert claims(other) == [False]
        return
    process.identity.claim()
    process.listener.take_waiting()
    assert claims(other) == [False, True]


def test_a_claimant_waits_while_somebody_seems_to_be_there_and_goes_on_when_it_has_gone() -> None:
    hub = MemoryHub()
    process, others = Process(hub), hub.connect("others")
    say(others, "here")
    others.subscribe(CLAIM)
    waiting = in_thread(process.identity.claim)
    assert heard(others).holds is False
    rival(others)  # who comes meanwhile has come later, and is told so: by then this one waits
    assert heard(others).who == "another"
    assert heard(others).holds is True
    assert waiting.is_alive()
    say(others, "gone")
    joined(waiting)
    process.identity.announce(1)
    assert retained(hub) == Presence(agent=ME, stage=1)


def test_a_claimant_is_refused_by_the_answer_of_who_was_there() -> None:
    hub = MemoryHub()
    process, others = Process(hub), hub.connect("others")
    say(others, "here", stage=5)
    refused: list[ConfigurationError] = []

    def claim() -> None:
        try:
            process.identity.claim()
        except ConfigurationError as error:
            refused.append(error)

    others.subscribe(CLAIM)
    claiming = in_thread(claim)
    heard(others)
    rival(others, holds=True)
    joined(claiming)
    assert len(refused) == 1
    assert retained(hub) == Presence(agent=ME, stage=5)


def test_one_that_never_answers_and_never_goes_is_not_waited_for_for_ever() -> None:
    hub = MemoryHub()
    say(hub.connect("others"), "here")
    Process(hub, keepalive_s=0.0).identity.claim()


def test_one_that_is_established_and_hears_that_it_has_gone_says_again_where_it_stands() -> None:
    hub = MemoryHub()
    process, others = Process(hub), hub.connect("others")
    process.identity.claim()
    process.identity.announce(2)
    process.identity.announce(3)
    say(others, "gone", stage=0)  # the last will of a connection that was lost
    process.listener.take_waiting()
    assert retained(hub) == Presence(agent=ME, stage=3)


def test_garbage_on_the_claim_topic_is_refused_and_counted() -> None:
    hub = MemoryHub()
    process = Process(hub)
    process.identity.claim()
    hub.connect("others").publish(CLAIM, b"{}")
    process.listener.take_waiting()
    assert process.listener.refused == 1
