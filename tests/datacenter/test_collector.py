"""The data center's ear: what comes in any order is put in order, what is wrong refused, what is lost asked for."""

import random
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from jouleswarm.common.bus.bus import MemoryBus, MemoryHub
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.errors import RunError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import MotionHeader, Presence, RoundRequest, decode_json, encode_json
from jouleswarm.datacenter.collector import Collector
from tests.made_up import encode_motion

RUN, ARM = "r", "maml"
DEADLINE_S = 20.0
MOTIONS = 4  # a round, in the scenario of conftest.py; robots 1 (task 1) and 3 (task 2) send


def motion(agent: int, round_: int, index: int, /, **fields: Any) -> bytes:
    header = {
        "task": {1: 1, 3: 2}[agent], "agent": agent, "round": round_, "motion": index, "action": 0,
        "reward": float(100 * round_ + 10 * agent + index), "first": index == 0, "terminated": False, **fields,
    }  # fmt: skip
    return encode_motion(np.full((12, 16, 4), index, np.uint8), MotionHeader.model_validate(header))


class Table:
    def __init__(self, scenario: Scenario, collected: int = 0) -> None:
        self.hub = MemoryHub()
        self.robots, self.ears = self.hub.connect("robots"), self.hub.connect("ears")
        listener = Listener(self.hub.connect("datacenter"), scenario.bus.resend_after_s)
        self.collector = Collector(listener, scenario, RUN, ARM)
        self.collector.join(collected)

    def send(self, agent: int, payload: bytes) -> None:
        self.robots.publish(topics.experience(RUN, ARM, {1: 1, 3: 2}[agent], agent), payload)

    def send_round(self, round_: int, agents: tuple[int, ...] = (1, 3)) -> None:
        for agent in agents:
            for index in range(MOTIONS):
                self.send(agent, motion(agent, round_, index))

    def present(self, task: int, agent: int, stage: int, state: str = "here") -> None:
        presence = Presence.model_validate({"agent": agent, "stage": stage, "state": state})
        self.robots.publish(topics.presence(RUN, task, agent), encode_json(presence), retain=True)

    def rewards(self, round_: int) -> dict[int, list[list[float]]]:
        return {
            task: [[each.header.reward for each in robot] for robot in robots]
            for task, robots in self.collector.collect(round_).items()
        }


ROUND_1 = {1: [[110.0, 111.0, 112.0, 113.0]], 2: [[130.0, 131.0, 132.0, 133.0]]}
ROUND_2 = {1: [[210.0, 211.0, 212.0, 213.0]], 2: [[230.0, 231.0, 232.0, 233.0]]}


@pytest.fixture
def table(make_scenario: Callable[..., Scenario]) -> Table:
    return Table(make_scenario())


@pytest.fixture
def impatient(make_scenario: Callable[..., Scenario]) -> Table:
    return Table(make_scenario(bus={"resend_after_s": 0.02}))


@pytest.fixture
def make_scenario(make_scenario: Callable[..., Scenario]) -> Callable[..., Scenario]:
    return lambda bus=None: make_scenario().model_copy(
        update={"bus": make_scenario().bus.model_copy(update=bus or {"resend_after_s": 60.0})}
    )


def test_motions_out_of_order_are_put_in_order(table: Table) -> None:
    sent = [(agent, motion(agent, 1, index)) for agent in (1, 3) for index in range(MOTIONS)]
    random.Random(1).shuffle(sent)
    for agent, payload in sent:
        table.send(agent, payload)
    assert table.rewards(1) == ROUND_1


def test_frames_are_kept_at_the_networks_size_as_bytes(table: Table) -> None:
    table.send_round(1)
    kept = table.collector.collect(1)[1][0][2].frame
    assert (kept.shape, kept.dtype) == ((6, 8, 4), np.uint8)
    assert set(kept.ravel().tolist()) == {2}


def test_duplicates_change_nothing(table: Table) -> None:
    for _ in range(3):
        table.send(1, motion(1, 1, 0))
    table.send_round(1)
    table.send_round(2)
    assert table.rewards(1) == ROUND_1
    table.send_round(1)  # a round that is in hand already
    assert table.rewards(2) == ROUND_2
    assert table.collector.refused == 0


def test_the_round_after_may_come_first(table: Table) -> None:
    table.send_round(2)
    table.send_round(1)
    assert table.rewards(1) == ROUND_1
    assert table.rewards(2) == ROUND_2


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"garbage",
        motion(1, 1, 0)[:-1],
        motion(1, 1, 0, agent=3),
        motion(1, 1, 0, task=2),
        motion(1, 1, MOTIONS),
        motion(1, 3, 0),
        motion(1, 10**6, 0),
        encode_motion(
            np.zeros((12, 12, 4), np.uint8),
            MotionHeader(task=1, agent=1, round=1, motion=0, action=0, reward=0, first=True, terminated=False),
        ),
    ],
    ids=["empty", "garbage", "truncated", "agent", "task", "motion", "too early", "far future", "frame size"],
)
def test_a_bad_payload_is_refused_counted_and_waited_past(table: Table, payload: bytes) -> None:
    table.send(1, payload)
    table.send_round(1)
    assert table.rewards(1) == ROUND_1
    assert table.collector.refused == 1


def test_garbage_on_control_topics_is_refused_and_counted(table: Table) -> None:
    table.robots.publish(topics.meta_resend(RUN, ARM), b"\xff")
    table.robots.publish(topics.presence(RUN, 1, 1), b"[]")
    table.robots.publish(topics.presence(RUN, 1, 1), b"")  # who leaves clears its presence: nothing wrong with that
    table.send_round(1)
    assert table.rewards(1) == ROUND_1
    assert table.collector.refused == 2


def in_thread(call: Callable[[], Any]) -> tuple[threading.Thread, list[Any]]:
    got: list[Any] = []
    thread = threading.Thread(target=lambda: got.append(call()), daemon=True)
    thread.start()
    return thread, got


def asked(ears: MemoryBus) -> tuple[str, RoundRequest]:
    message = ears.receive(DEADLINE_S)
    assert message is not None, "nothing was asked for"
    return message.topic, decode_json(message.payload, RoundRequest)


def test_a_motion_that_was_lost_is_asked_for_again(impatient: Table) -> None:
    impatient.ears.subscribe(*(topics.collect_again(RUN, ARM, task, agent) for task, agent in ((1, 1), (2, 3))))
    impatient.present(1, 1, 0)
    impatient.present(2, 3, 0)
    impatient.send_round(1, (3,))
    for index in (0, 1, 3):
        impatient.send(1, motion(1, 1, index))
    thread, got = in_thread(lambda: impatient.rewards(1))
    for _ in range(2):  # and again, as long as it does not come
        assert asked(impatient.ears) == (topics.collect_again(RUN, ARM, 1, 1), RoundRequest(first=1, last=1))
    impatient.send(1, motion(1, 1, 2))
    thread.join(DEADLINE_S)
    assert got == [ROUND_1]


def test_a_round_that_was_lost_whole_is_asked_for_again(make_scenario: Callable[..., Scenario]) -> None:
    # As after a restart: the robots sent round 3 to the data center that died.
    table = Table(make_scenario(bus={"resend_after_s": 0.02}), collected=2)
    table.ears.subscribe(topics.collect_again(RUN, ARM, 1, 1))
    table.present(1, 1, 0)
    table.present(2, 3, 0)
    table.send_round(3, (3,))
    thread, got = in_thread(lambda: table.rewards(3))
    assert asked(table.ears) == (topics.collect_again(RUN, ARM, 1, 1), RoundRequest(first=3, last=3))
    table.send_round(3, (1,))
    thread.join(DEADLINE_S)
    assert got == [{1: [[310.0, 311.0, 312.0, 313.0]], 2: [[330.0, 331.0, 332.0, 333.0]]}]


def test_wanted_rounds_are_retained_for_robots_that_come_later(table: Table) -> None:
    table.collector.announce_wanted(1, 2)
    table.collector.announce_wanted(2, 3)
    table.ears.subscribe(topics.meta_round(RUN, ARM))
    assert asked(table.ears)[1] == RoundRequest(first=2, last=3)
    assert table.ears.receive(0.001) is None


ROBOTS = ((1, 1), (1, 2), (2, 3), (2, 4), (3, 5), (3, 6))


def test_the_data_center_may_go_when_every_robot_has_come_far_enough(table: Table) -> None:
    for task, agent in ROBOTS:
        table.present(task, agent, 1)
    assert table.collector.robots_that_missed_a_model() is None


def test_a_robot_that_missed_the_meta_model_is_named(table: Table) -> None:
    for task, agent in ROBOTS[:-1]:
        table.present(task, agent, 1)
    table.robots.publish(topics.meta_resend(RUN, ARM), encode_json(RoundRequest(first=6, last=6)))
    assert table.collector.robots_that_missed_a_model() == [(ARM, 6)]
    table.robots.publish(topics.meta_resend(RUN, ARM), encode_json(RoundRequest(first=99, last=99)))  # nobody
    table.present(3, 6, 1)
    assert table.collector.robots_that_missed_a_model() is None


def test_a_robot_that_died_does_not_count_as_having_the_model(table: Table) -> None:
    for task, agent in ROBOTS[:-1]:
        table.present(task, agent, 1)
    table.present(3, 6, 1, state="gone")
    table.robots.publish(topics.meta_resend(RUN, ARM), encode_json(RoundRequest(first=1, last=1)))
    assert table.collector.robots_that_missed_a_model() == [(ARM, 1)]  # it goes on waiting, for requests too
    table.present(3, 6, 1)
    assert table.collector.robots_that_missed_a_model() is None


def test_a_robot_that_is_past_meta_learning_has_been_here_with_this_data_center(table: Table) -> None:
    table.present(1, 1, 1)
    table.present(2, 3, 0)
    with pytest.raises(RunError, match="robot 1 is past meta-learning already, and the data center comes with round 1"):
        table.collector.collect(1)
