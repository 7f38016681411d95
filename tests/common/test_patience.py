"""No wait without a name and an end, by a clock of the test's own, over the in-memory bus."""

from __future__ import annotations

import pytest

from jouleswarm.common.bus import patience as module
from jouleswarm.common.bus.bus import MemoryBus, MemoryHub
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.bus.patience import Patience
from jouleswarm.common.errors import PayloadError, RunError
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Wait, decode_json

RUN, LIMIT_S = "r", 600.0


class Clock:
    """Stands until it is told to go on."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    return clock


class Process:
    """One that may wait, and hears when others ask."""

    def __init__(self, hub: MemoryHub, client: str, limit_s: float = LIMIT_S) -> None:
        self.bus = hub.connect(client)
        self.patience = Patience(self.bus, RUN, limit_s)
        self.listener = Listener(self.bus, 10.0, self.patience)

    def ask(self, whom: Process | str, what: str = "round 8") -> None:
        self.patience.ask([whom if isinstance(whom, str) else whom.bus.client], what)


def exchanged(*processes: Process) -> None:
    """Questions are heard and answered, and the answers heard."""
    for _ in range(2):
        for each in processes:
            each.listener.take_waiting()


def heard(bus: MemoryBus) -> Wait:
    message = bus.receive(0)
    assert message is not None
    return decode_json(message.payload, Wait)


@pytest.fixture
def hub() -> MemoryHub:
    return MemoryHub()


def test_who_does_not_answer_is_given_up_by_name_at_the_limit(hub: MemoryHub, clock: Clock) -> None:
    one = Process(hub, "agent-1")
    one.patience.begin()
    clock.now_s += LIMIT_S - 0.1
    one.ask("agent-2")
    clock.now_s += 0.1
    with pytest.raises(RunError, match=r"waiting for round 8: agent-2 was not heard of within the 600 s"):
        one.ask("agent-2")
    assert RunError.exit_code == 5


def test_who_is_at_work_is_waited_for_however_long_and_then_as_long_as_anybody(hub: MemoryHub, clock: Clock) -> None:
    one, two = Process(hub, "agent-1"), Process(hub, "agent-2")
    one.patience.begin()
    for _ in range(5):
        clock.now_s += LIMIT_S - 1
        one.ask(two)
        exchanged(one, two)
    clock.now_s += LIMIT_S - 1
    one.ask(two)  # and now it dies
    clock.now_s += 1
    with pytest.raises(RunError, match="agent-2 was not heard of"):
        one.ask(two)


def test_a_chain_of_waits_ends_when_its_end_has_been_silent_for_too_long(hub: MemoryHub, clock: Clock) -> None:
    one, two = Process(hub, "agent-1"), Process(hub, "agent-2")
    two.patience.begin()
    two.ask("agent-3", "round 8 of robots [3]")
    clock.now_s += 100
    one.patience.begin()  # robot 2 answers that it has waited for 100 s, but robot 1 counts its own wait only
    one.ask(two)
    exchanged(one, two)
    clock.now_s += 499
    one.ask(two)
    exchanged(one, two)
    clock.now_s += 101
    with pytest.raises(RunError, match=r"agent-2 waits for round 8 of robots \[3\] within the 600 s"):
        one.ask(two, "round 9")


def test_two_that_wait_for_each_other_do_not_wait_for_ever(hub: MemoryHub, clock: Clock) -> None:
    one, two = Process(hub, "agent-1"), Process(hub, "agent-2")
    for each in (one, two):
        each.patience.begin()
    for _ in range(59):
        clock.now_s += 10
        one.ask(two)
        two.ask(one)
        exchanged(one, two)
    clock.now_s += 10
    with pytest.raises(RunError):
        one.ask(two)


@pytest.mark.parametrize("limit_s", [0.0, 1e9])
def test_zero_is_never(hub: MemoryHub, clock: Clock, limit_s: float) -> None:
    one = Process(hub, "agent-1", limit_s)
    one.patience.begin()
    clock.now_s += 1e8
    one.ask("agent-2")


def test_a_wait_for_nobody_in_particular_has_an_end_too(hub: MemoryHub, clock: Clock) -> None:
    one = Process(hub, "agent-1")
    one.patience.begin()
    clock.now_s += LIMIT_S
    with pytest.raises(RunError, match="waiting for the broker: nothing came within the 600 s"):
        one.patience.ask([], "the broker")


def test_the_recorder_is_told_of_every_wait_and_nothing_is_metered(hub: MemoryHub, clock: Clock) -> None:
    recorder, one = hub.connect("recorder"), Process(hub, "agent-1")
    recorder.subscribe(topics.wait(RUN, "recorder"))
    one.patience.place = lambda client: (1, 7)
    one.patience.begin()
    clock.now_s += 30
    one.ask("agent-2", "x" * 1000)  # as of very many robots
    wait = Wait(client="agent-1", what="x" * 300, quiet_s=30, stage=1, round=7)
    assert heard(recorder) == wait
    one.patience.end()
    hub.connect("agent-2").publish(
        topics.wait(RUN, "agent-1"), Wait(client="recorder", asks=True).model_dump_json().encode()
    )
    exchanged(one)
    assert heard(recorder) == Wait(client="agent-1", stage=1, round=7)  # it is at work
    assert hub.meter.rows() == []


def test_an_answer_of_one_that_is_not_waited_for_is_nobodys_concern(hub: MemoryHub, clock: Clock) -> None:
    one, two, told = Process(hub, "agent-1"), Process(hub, "agent-2"), []
    one.patience.told = told.append
    one.patience.begin()
    one.ask(two)
    two.bus.publish(topics.wait(RUN, "agent-1"), Wait(client="agent-3", round=1000).model_dump_json().encode())
    exchanged(one, two)
    assert [wait.client for wait in told] == ["agent-2"]


def test_garbage_is_refused(hub: MemoryHub) -> None:
    one, others = Process(hub, "agent-1"), hub.connect("others")
    for payload in (b"\xff", b"{}", b'{"client": "a", "quiet_s": 1e999}', b'{"client": "a", "quiet_s": -1}'):
        others.publish(topics.wait(RUN, "agent-1"), payload)
    one.listener.take_waiting()
    assert one.listener.refused == 4
    with pytest.raises(PayloadError):
        decode_json(b"[]", Wait)


def test_a_listener_gives_up_what_does_not_come(hub: MemoryHub, clock: Clock) -> None:
    bus = hub.connect("agent-1")
    patience = Patience(bus, RUN, 0.5)
    listener = Listener(bus, 0.0, patience)

    def time_passes() -> bool:
        clock.now_s += 0.1
        return False

    with pytest.raises(RunError, match=r"waiting for robot 2 to come: agent-2 was not heard of within the 0\.5 s"):
        listener.until(time_passes, lambda: "robot 2 to come", whom=lambda: ["agent-2"])
