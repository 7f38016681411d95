"""A robot's side of the protocol, over the in-memory bus: what it waits for, what it asks for, what it refuses."""

import threading
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import pytest

from jouleswarm.agents.meta_stage import MetaLink
from jouleswarm.agents.peers import Exchange
from jouleswarm.common.bus.bus import MemoryBus, MemoryHub, Message
from jouleswarm.common.errors import RunError
from jouleswarm.common.host import arithmetic
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.sections import Bus, Federation
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import ModelHeader, Presence, RoundRequest, Wait, decode_json, encode_json
from jouleswarm.common.wire.models import encode_model
from jouleswarm.methods.graph import Neighbourhood

RUN, ARM, TASK, ME = "r", "maml", 1, 1
SHAPES = {"w": (2,)}
PATIENT_S, IMPATIENT_S = 60.0, 0.02
DEADLINE_S = 20.0
Result = TypeVar("Result")


class Running:
    """A call in a thread of its own, that must end before a deadline."""

    def __init__(self, call: Callable[[], Result]) -> None:
        self._got: list[Result] = []
        self._error: list[BaseException] = []
        self._thread = threading.Thread(target=self._run, args=(call,), daemon=True)
        self._thread.start()

    def _run(self, call: Callable[[], Result]) -> None:
        try:
            self._got.append(call())
        except BaseException as error:  # noqa: BLE001 - raised again by result()
            self._error.append(error)

    def result(self) -> Result:
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive(), "still waiting"
        if self._error:
            raise self._error[0]
        return self._got[0]

    @property
    def waits(self) -> bool:
        return self._thread.is_alive()


class Table:
    """Robot 1 of a cluster of three, and the hands of the others."""

    def __init__(self, resend_after_s: float = PATIENT_S, federation: Federation | None = None) -> None:
        self.hub = MemoryHub()
        here = Neighbourhood(agent=ME, task=TASK, cluster=(1, 2, 3), neighbours=(2, 3), diameter=1)
        self.exchange = Exchange(
            self.hub.connect("agent-1"),
            RUN,
            here,
            SHAPES,
            Bus(resend_after_s=resend_after_s),
            federation or Federation(),
        )
        self.others = self.hub.connect("others")
        self.ears = self.hub.connect("ears")
        self.meta = MetaLink(self.exchange, lambda arm: SHAPES)
        self.meta.listen([Arm(ARM, ARM, 3)])
        self.exchange.join()
        self.exchange.open_arm(Arm(ARM, ARM, 3), here, 2)

    def listen(self, *filters: str) -> MemoryBus:
        self.ears.subscribe(*filters)
        return self.ears

    def send(self, agent: int, round_: int, value: float = 0.0, arm: str = ARM, **header: object) -> None:
        fields = {
            "task": TASK, "agent": agent, "round": round_, "reward": 1.0, "samples": 20,
            "rewards": {agent: (round_, 1.0)}, **header,
        }  # fmt: skip
        payload = encode_model({"w": np.full(2, value, np.float32)}, ModelHeader.model_validate(fields))
        self.others.publish(topics.weights(RUN, arm, TASK, agent), payload)

    def send_raw(self, agent: int, payload: bytes) -> None:
        self.others.publish(topics.weights(RUN, ARM, TASK, agent), payload)

    def present(self, agent: int, stage: int, state: str = "here") -> None:
        presence = Presence.model_validate({"agent": agent, "stage": stage, "state": state})
        self.others.publish(topics.presence(RUN, TASK, agent), encode_json(presence), retain=True)

    def values(self, round_: int) -> dict[int, float]:
        return {agent: float(weights["w"][0]) for agent, (weights, _) in self.exchange.gather(round_).items()}


def heard(bus: MemoryBus) -> Message:
    message = bus.receive(DEADLINE_S)
    assert message is not None, "nothing was said"
    return message


def test_gather_takes_all_neighbours_in_whatever_order() -> None:
    table = Table()
    table.send(3, 1, 30.0)
    table.send(2, 1, 20.0)
    assert table.values(1) == {2: 20.0, 3: 30.0}


def test_gather_waits_until_the_last_neighbour_has_sent() -> None:
    table = Table()
    table.send(2, 1, 20.0)
    gathering = Running(lambda: table.values(1))
    # what the waiting robot does meanwhile shows that it has taken robot 2's weights and goes on waiting
    ears = table.listen(topics.weights(RUN, ARM, TASK, ME))
    table.exchange.publish_weights({"w": np.zeros(2, np.float32)}, header(1))
    heard(ears)
    table.others.publish(topics.resend(RUN, ARM, TASK, ME), encode_json(RoundRequest(first=1, last=1)))
    heard(ears)
    assert gathering.waits
    table.send(3, 1, 30.0)
    assert gathering.result() == {2: 20.0, 3: 30.0}


def header(round_: int) -> ModelHeader:
    return ModelHeader(task=TASK, agent=ME, round=round_, reward=1.0, samples=20, rewards={ME: (round_, 1.0)})


def test_a_robot_without_neighbours_gathers_nothing_at_once() -> None:
    here = Neighbourhood(agent=1, task=1, cluster=(1,), neighbours=(), diameter=1)
    exchange = Exchange(MemoryHub().connect("agent-1"), RUN, here, SHAPES, Bus(resend_after_s=PATIENT_S), Federation())
    exchange.join()
    exchange.open_arm(Arm(ARM, ARM, 3), here, 2)
    exchange.await_stage(1)
    assert exchange.gather(1) == {}


def test_a_neighbour_one_round_ahead_is_kept_for_the_next_round() -> None:
    table = Table()
    table.send(2, 1, 21.0)
    table.send(2, 2, 22.0)
    table.send(3, 1, 31.0)
    assert table.values(1) == {2: 21.0, 3: 31.0}
    table.send(3, 2, 32.0)
    assert table.values(2) == {2: 22.0, 3: 32.0}


def test_duplicates_and_weights_of_rounds_gone_by_change_nothing() -> None:
    table = Table()
    table.send(2, 1, 21.0)
    table.send(3, 1, 31.0)
    table.values(1)
    table.send(2, 1, 99.0)  # sent again, too late
    table.send(2, 2, 22.0)
    table.send(2, 2, 22.0)
    table.send(3, 2, 32.0)
    assert table.values(2) == {2: 22.0, 3: 32.0}
    table.send(2, 3, 23.0)
    table.send(3, 3, 33.0)
    assert table.values(3) == {2: 23.0, 3: 33.0}
    assert table.exchange.refused == 0


def test_weights_of_a_round_that_no_neighbour_can_have_reached_are_not_kept() -> None:
    table = Table(IMPATIENT_S)
    table.send(2, 4, 99.0)  # nobody passes round 2 before this robot has sent its own
    for round_ in (1, 2, 3):
        for agent in (2, 3):
            table.send(agent, round_, 10.0 * agent + round_)
        table.values(round_)
    ears = table.listen(topics.resend(RUN, ARM, TASK, 2))
    table.send(3, 4, 34.0)
    gathering = Running(lambda: table.values(4))
    heard(ears)
    table.send(2, 4, 24.0)
    assert gathering.result() == {2: 24.0, 3: 34.0}


def test_weights_of_another_arm_change_nothing() -> None:
    # An answer to a request of the first arm can come when the second has begun.
    table = Table()
    table.send(2, 1, 1.0)
    table.send(3, 1, 1.0)
    table.values(1)
    table.exchange.open_arm(Arm("fl", "fl", 0), table.exchange.here, 2)
    table.send(2, 1, 99.0, arm="maml")
    table.send(3, 1, 30.0, arm="fl")
    table.send(2, 1, 20.0, arm="fl")
    table.send(2, 1, 99.0, arm="maml")
    assert table.values(1) == {2: 20.0, 3: 30.0}
    table.send(2, 2, 98.0, arm="maml")
    gathering = Running(lambda: table.values(2))
    table.send(3, 2, 31.0, arm="fl")
    table.send(2, 2, 21.0, arm="fl")
    assert gathering.result() == {2: 21.0, 3: 31.0}


def good(**fields: object) -> bytes:
    base = {"task": TASK, "agent": 2, "round": 1, "reward": 1.0, "samples": 20, "rewards": {2: (1, 1.0)}}
    return encode_model({"w": np.ones(2, np.float32)}, ModelHeader.model_validate({**base, **fields}))


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"garbage",
        good()[:-1],
        encode_model({"w": np.ones(3, np.float32)}, ModelHeader(task=1, agent=2, round=1, reward=1.0, samples=20)),
        encode_model({"w": np.full(2, np.nan, np.float32)}, ModelHeader(task=1, agent=2, round=1, samples=20)),
        encode_model({"w": np.full(2, 1e5, np.float32)}, ModelHeader(task=1, agent=2, round=1, samples=20)),
        good(agent=3),
        good(task=2),
        good(reward=None),
        good(samples=0),
        good(rewards={}),  # the rewards are what the cluster decides by
    ],
    ids=[
        "empty",
        "garbage",
        "truncated",
        "shape",
        "NaN",
        "wild",
        "agent",
        "task",
        "no reward",
        "no samples",
        "no rewards",
    ],
)
def test_a_bad_payload_is_refused_counted_and_waited_past(payload: bytes) -> None:
    table = Table()
    table.send(3, 1, 30.0)
    table.send_raw(2, payload)
    table.send(2, 1, 20.0)
    assert table.values(1) == {2: 20.0, 3: 30.0}
    assert table.exchange.refused == 1


@pytest.mark.parametrize(
    "topic",
    [
        topics.presence(RUN, TASK, 2),
        topics.meta_round(RUN, ARM),
        topics.meta_model(RUN, ARM),
        topics.collect_again(RUN, ARM, TASK, ME),
        topics.resend(RUN, ARM, TASK, ME),
    ],
)
def test_garbage_on_any_topic_is_refused_and_counted(topic: str) -> None:
    table = Table()
    table.others.publish(topic, b"\xff garbage")
    table.send(2, 1, 20.0)
    table.send(3, 1, 30.0)
    assert table.values(1) == {2: 20.0, 3: 30.0}
    assert table.exchange.refused == 1


def test_what_has_not_come_is_asked_for_again_from_who_has_not_sent_it() -> None:
    table = Table(IMPATIENT_S)
    ears = table.listen(topics.resend(RUN, ARM, TASK, 2), topics.resend(RUN, ARM, TASK, 3))
    table.send(3, 1, 30.0)
    gathering = Running(lambda: table.values(1))
    for _ in range(2):  # and again, as long as it does not come
        message = heard(ears)
        assert message.topic == topics.resend(RUN, ARM, TASK, 2)
        assert decode_json(message.payload, RoundRequest) == RoundRequest(first=1, last=1)
    table.send(2, 1, 20.0)
    assert gathering.result() == {2: 20.0, 3: 30.0}


def test_a_request_is_answered_with_this_rounds_or_the_last_rounds_weights() -> None:
    table = Table()
    ears = table.listen(topics.weights(RUN, ARM, TASK, ME))
    sent = {
        round_: table.exchange.publish_weights({"w": np.full(2, round_, np.float32)}, header(round_))
        for round_ in (1, 2, 3)
    }
    for _ in sent:
        heard(ears)
    for round_ in (1, 2, 3):  # round 1 is forgotten: every neighbour had it when round 2 was gathered
        table.others.publish(topics.resend(RUN, ARM, TASK, ME), encode_json(RoundRequest(first=round_, last=round_)))
    table.send(2, 1)
    table.send(3, 1)
    table.exchange.gather(1)
    assert [heard(ears).payload for _ in range(2)] == [sent[2], sent[3]]
    assert ears.receive(0.001) is None


def test_a_request_from_before_there_was_anything_to_send_costs_no_second_copy() -> None:
    table = Table()
    ears = table.listen(topics.weights(RUN, ARM, TASK, ME))
    table.others.publish(topics.resend(RUN, ARM, TASK, ME), encode_json(RoundRequest(first=1, last=1)))
    sent = table.exchange.publish_weights({"w": np.zeros(2, np.float32)}, header(1))
    table.send(2, 1)
    table.send(3, 1)
    table.exchange.gather(1)
    assert heard(ears).payload == sent
    assert ears.receive(0.001) is None


def test_stages_are_waited_for_and_a_robot_that_went_does_not_count_as_come() -> None:
    table = Table()
    table.present(2, 1)
    table.present(3, 0)
    waiting = Running(lambda: table.exchange.await_stage(1))
    ears = table.listen(topics.weights(RUN, ARM, TASK, ME))
    table.exchange.publish_weights({"w": np.zeros(2, np.float32)}, header(1))
    heard(ears)
    table.present(3, 1, state="gone")
    table.others.publish(topics.resend(RUN, ARM, TASK, ME), encode_json(RoundRequest(first=1, last=1)))
    heard(ears)  # by now the 'gone' has been taken, and the robot waits on
    assert waiting.waits
    table.present(3, 1)
    waiting.result()


def test_a_neighbour_cannot_speak_for_the_data_center() -> None:
    table = Table()
    told = encode_json(Presence(agent=0, stage=9))
    table.others.publish(topics.presence(RUN, TASK, 2), told, retain=True)
    table.send(2, 1)
    table.send(3, 1)
    table.exchange.gather(1)
    assert (table.exchange.refused, table.exchange._datacenter_stage) == (1, 0)


def test_presence_is_retained_for_robots_that_come_later() -> None:
    table = Table()
    table.exchange.announce(3)
    late = table.hub.connect("late")
    late.subscribe(topics.presence(RUN, TASK, ME))
    message = heard(late)
    assert message.retained
    assert decode_json(message.payload, Presence) == Presence(agent=ME, stage=3, processor=arithmetic())


def want(table: Table, first: int, last: int) -> None:
    table.others.publish(topics.meta_round(RUN, ARM), encode_json(RoundRequest(first=first, last=last)), retain=True)


def test_wanted_rounds_are_due_once_and_in_order_until_the_stage_is_over() -> None:
    table = Table()
    want(table, 1, 2)
    assert table.meta.await_rounds_due(ARM, set(), t0=3) == [1, 2]
    want(table, 2, 3)
    assert table.meta.await_rounds_due(ARM, {1, 2}, t0=3) == [3]
    want(table, 4, 4)
    assert table.meta.await_rounds_due(ARM, {1, 2, 3}, t0=3) == []


@pytest.mark.parametrize("round_", [0, 3, 2**53])
def test_a_round_that_meta_learning_does_not_have_is_never_due(round_: int) -> None:
    table = Table()
    request = encode_json(RoundRequest(first=round_, last=round_))
    table.others.publish(topics.collect_again(RUN, ARM, TASK, ME), request)
    want(table, 3, 3)
    assert table.meta.await_rounds_due(ARM, {1, 2}, t0=2) == []


def test_a_round_asked_for_again_is_due_again() -> None:
    table = Table()
    want(table, 1, 2)
    table.others.publish(topics.collect_again(RUN, ARM, TASK, ME), encode_json(RoundRequest(first=1, last=1)))
    ears = table.listen(topics.meta_resend(RUN, ARM))
    assert table.meta.await_rounds_due(ARM, {1, 2}, t0=2) == [1]
    want(table, 3, 3)
    assert table.meta.await_rounds_due(ARM, {1, 2}, t0=2) == []  # once is enough
    assert ears.receive(0.001) is None


def meta_payload(round_: int = 3) -> bytes:
    return encode_model({"w": np.full(2, 5, np.float32)}, ModelHeader(task=0, agent=0, round=round_))


def test_the_meta_model_is_taken_from_the_downlink_without_asking() -> None:
    table = Table()
    ears = table.listen(topics.meta_resend(RUN, ARM))
    want(table, 1, 2)
    table.others.publish(topics.meta_model(RUN, ARM), meta_payload())
    want(table, 4, 4)
    assert table.meta.await_model(Arm(ARM, ARM, 3), 3)["w"].tolist() == [5.0, 5.0]
    assert ears.receive(0.001) is None


def test_a_meta_model_that_went_by_is_asked_for() -> None:
    table = Table()
    ears = table.listen(topics.meta_resend(RUN, ARM))
    want(table, 4, 4)  # the stage is over, and the meta-model was sent before this robot came
    waiting = Running(lambda: table.meta.await_model(Arm(ARM, ARM, 3), 3))
    assert decode_json(heard(ears).payload, RoundRequest) == RoundRequest(first=ME, last=ME)
    table.others.publish(topics.meta_model(RUN, ARM, ME), meta_payload())
    assert waiting.result()["w"].tolist() == [5.0, 5.0]


def test_a_meta_model_that_was_lost_is_asked_for_until_it_comes() -> None:
    table = Table(IMPATIENT_S)
    ears = table.listen(topics.meta_resend(RUN, ARM))
    want(table, 4, 4)
    waiting = Running(lambda: table.meta.await_model(Arm(ARM, ARM, 3), 3))
    for _ in range(3):
        assert decode_json(heard(ears).payload, RoundRequest) == RoundRequest(first=ME, last=ME)
    table.others.publish(topics.meta_model(RUN, ARM, ME), meta_payload())
    assert waiting.result()["w"].tolist() == [5.0, 5.0]


def test_stages_only_rise() -> None:
    table = Table()
    for agent, stage in ((2, 1), (3, 1), (2, 0)):  # an old word that comes late
        table.present(agent, stage)
    Running(lambda: table.exchange.await_stage(1)).result()


def test_a_neighbour_two_stages_ahead_has_been_here_with_this_robot() -> None:
    table = Table()
    table.present(3, 3, "done")
    for wait in (lambda: table.exchange.await_stage(1), lambda: table.exchange.gather(1)):
        with pytest.raises(RunError, match="robot 3 is at stage 3 already, and robot 1 comes with stage 1"):
            Running(wait).result()


@pytest.mark.parametrize(("round_", "told"), [(4, True), (3, False)])
def test_a_neighbour_more_than_two_rounds_ahead_has_been_here_with_this_robot(round_: int, told: bool) -> None:
    table = Table(IMPATIENT_S)
    table.exchange.announce(1)
    asked = table.listen(topics.wait(RUN, "agent-2"))
    table.send(3, 1)
    gathering = Running(lambda: table.exchange.gather(1))
    assert decode_json(heard(asked).payload, Wait).what == "round 1 of robots [2]"
    answer = Wait(client="agent-2", stage=1, round=round_)
    table.others.publish(topics.wait(RUN, "agent-1"), encode_json(answer))
    if told:
        with pytest.raises(RunError, match="agent-2 is in round 4 of maml already, and robot 1 comes with round 1"):
            gathering.result()
    else:
        table.send(2, 1)
        assert set(gathering.result()) == {2, 3}


def test_a_robot_tells_how_far_it_has_come() -> None:
    table = Table(IMPATIENT_S)
    table.exchange.announce(1)
    table.exchange.publish_weights({"w": np.zeros(2, np.float32)}, header(5))
    ears = table.listen(topics.wait(RUN, "agent-2"))
    table.others.publish(topics.wait(RUN, "agent-1"), encode_json(Wait(client="agent-2", asks=True)))
    table.exchange._listener.take_waiting()
    assert decode_json(heard(ears).payload, Wait) == Wait(client="agent-1", stage=1, round=5)


def test_a_robot_that_leaves_hears_no_more_and_hands_in_its_counters() -> None:
    table = Table()
    ears = table.listen(topics.meter_report(RUN, "agent-1"), topics.learned(RUN, ARM, TASK))
    table.exchange.hand_in(b"weights")
    table.exchange.hand_over(3, stay=False)
    table.exchange.leave()
    assert heard(ears) == Message(topics.learned(RUN, ARM, TASK), b"weights")
    assert heard(ears).topic == topics.meter_report(RUN, "agent-1")
    table.send(2, 1)
    received = [row for row in table.hub.meter.rows() if row.client == "agent-1" and row.direction == "out"]
    assert [row for row in received if "weights" in row.topic] == []


def test_a_model_of_a_round_on_the_way_is_not_asked_for_before_the_stage_is_over() -> None:
    table = Table(IMPATIENT_S)
    ears = table.listen(topics.meta_resend(RUN, "maml-t1"))
    early = Arm("maml-t1", ARM, 1)
    table.meta.listen([early])
    want(table, 3, 3)  # round 1 is long over, the stage of 3 rounds is not
    waiting = Running(lambda: table.meta.await_model(early, 3))
    for _ in range(3):
        assert ears.receive(IMPATIENT_S) is None
    assert waiting.waits
    want(table, 4, 4)
    assert decode_json(heard(ears).payload, RoundRequest) == RoundRequest(first=ME, last=ME)
    table.others.publish(topics.meta_model(RUN, "maml-t1", ME), meta_payload(1))
    assert waiting.result()["w"].tolist() == [5.0, 5.0]


def proceeding(missing_after_s: float = PATIENT_S) -> Table:
    return Table(IMPATIENT_S, Federation(on_missing="proceed", missing_after_s=missing_after_s))


def test_going_on_without_the_missing_a_neighbour_whose_connection_broke_off_is_left_out() -> None:
    table = proceeding()
    table.present(3, 0, "gone")
    table.send(2, 1, 20.0)
    assert table.values(1) == {2: 20.0}
    assert table.exchange.missed == (3,)


def test_going_on_without_the_missing_a_neighbour_that_says_nothing_is_left_out_after_the_deadline() -> None:
    table = proceeding(missing_after_s=IMPATIENT_S)
    table.send(3, 1, 30.0)
    assert table.values(1) == {3: 30.0}
    assert table.exchange.missed == (2,)


def test_who_was_left_out_is_waited_for_again_once_its_weights_come() -> None:
    table = proceeding()
    table.present(3, 0, "gone")
    table.send(2, 1, 20.0)
    table.values(1)
    table.send(3, 2, 30.0)
    table.send(2, 2, 21.0)
    assert table.values(2) == {2: 21.0, 3: 30.0}
    assert table.exchange.missed == ()
    table.send(2, 3, 22.0)
    gathering = Running(lambda: table.values(3))
    asked = table.listen(topics.resend(RUN, ARM, TASK, 3))  # it is waiting for robot 3, or it would not ask
    assert decode_json(heard(asked).payload, RoundRequest) == RoundRequest(first=3, last=3)
    table.send(3, 3, 31.0)
    assert gathering.result() == {2: 22.0, 3: 31.0}


def test_a_robot_that_finds_the_others_far_ahead_takes_up_their_model_and_their_round() -> None:
    table = proceeding()
    table.send(2, 5, 25.0)
    assert table.values(1) == {}
    assert table.exchange.missed == (2, 3)
    assert table.exchange.ahead == 5
    assert table.exchange.catch_up()["w"].tolist() == [25.0, 25.0]
    assert table.exchange.ahead == 0
    table.send(2, 6, 26.0)
    table.send(3, 6, 36.0)
    assert table.values(6) == {2: 26.0, 3: 36.0}


def test_waiting_for_all_a_model_of_far_ahead_is_no_reason_to_go_on() -> None:
    table = Table(IMPATIENT_S)
    table.send(2, 5, 25.0)
    gathering = Running(lambda: table.values(1))
    heard(table.listen(topics.resend(RUN, ARM, TASK, 2)))
    assert gathering.waits
    assert table.exchange.ahead == 0
    for agent in (2, 3):
        table.send(agent, 1, float(agent))
    assert gathering.result() == {2: 2.0, 3: 3.0}


def test_who_is_gone_is_not_waited_for_at_the_end_of_an_arm_either() -> None:
    table = proceeding()
    table.present(2, 1)
    table.present(3, 0, "gone")
    Running(lambda: table.exchange.await_stage(1)).result()
