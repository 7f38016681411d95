"""The data center in every round: whose round is complete, what it answers, what it asks for again."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
import pytest

from jouleswarm.codecs.floats import FLOAT32
from jouleswarm.codecs.models import read_model
from jouleswarm.codecs.raw import Raw
from jouleswarm.common.bus.bus import MemoryHub
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.bus.patience import Patience
from jouleswarm.common.errors import PayloadError, RunError
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import (
    ModelHeader,
    MotionHeader,
    Presence,
    RoundRequest,
    Wait,
    decode_json,
    encode_json,
)
from jouleswarm.common.wire.models import encode_model
from jouleswarm.datacenter.cluster_rounds import ClusterDesk, Turn
from jouleswarm.datacenter.experience import read_motion
from jouleswarm.datacenter.services import ExperienceService, WeightsService
from jouleswarm.learning.networks import build_qnetwork, shapes_of
from jouleswarm.methods.mixing import weighted_average
from tests.made_up import encode_motion

Make = Callable[..., Scenario]
RUN, DONE = "r", 2
FEDAVG, CENTRALIZED = (Arm(name, name, 0) for name in ("fedavg", "centralized"))
ROBOTS = {1: 1, 2: 1, 3: 2, 4: 2, 5: 3, 6: 3}  # robot -> task
DEADLINE_S = 20.0


def test_the_average_is_weighed_by_samples() -> None:
    models = [{"w": np.full(2, 1, np.float32)}, {"w": np.full(2, 5, np.float32)}]
    assert weighted_average(models, [10, 30])["w"].tolist() == [4.0, 4.0]  # 1/4 + 15/4


class Table:
    """The parameter server's desk, and the hands of all robots."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.shapes = shapes_of(build_qnetwork(scenario))
        self.hub = MemoryHub()
        self.robots, self.ears = self.hub.connect("robots"), self.hub.connect("ears")
        self.server = WeightsService(scenario, FEDAVG)
        bus = self.hub.connect("datacenter")
        listener = Listener(bus, scenario.bus.resend_after_s, Patience(bus, RUN, 600.0))
        self.desk = ClusterDesk(listener, scenario, RUN, "fedavg", self.server, DONE)
        self.desk.listen()

    def send(self, sender: int, round_: int, value: float = 0.0, **fields: object) -> None:
        header = {
            "task": ROBOTS[sender], "agent": sender, "round": round_, "reward": 1.0, "samples": 10,
            "rewards": {sender: (round_, 100.0 * sender)}, **fields,
        }  # fmt: skip
        weights = {name: np.full(shape, value, np.float32) for name, shape in self.shapes.items()}
        payload = encode_model(weights, ModelHeader.model_validate(header))
        self.robots.publish(topics.weights_up(RUN, "fedavg", ROBOTS[sender], sender), payload)

    def present(self, *agents: int, stage: int) -> None:
        for agent in agents:
            presence = encode_json(Presence(agent=agent, stage=stage))
            self.robots.publish(topics.presence(RUN, ROBOTS[agent], agent), presence, retain=True)

    def turn(self) -> Turn[object]:
        turn = self.desk.next_round()
        assert turn is not None
        return turn


@pytest.fixture
def table(make_scenario: Make) -> Table:
    return Table(make_scenario(methods=["fedavg"], federation={"reward_window": 1}))


def test_a_round_is_complete_when_all_of_the_cluster_have_sent(table: Table) -> None:
    table.send(3, 1, 30.0)
    table.send(1, 1, 10.0)
    table.send(4, 1, 40.0)
    turn = table.turn()
    assert (turn.task, turn.round, sorted(turn.arrived)) == (2, 1, [3, 4])


def test_the_cluster_gets_its_average_with_all_that_is_known_of_rewards(table: Table) -> None:
    table.ears.subscribe(topics.cluster_model(RUN, "fedavg", 1))
    table.send(1, 1, 1.0, samples=10)
    table.send(2, 1, 5.0, samples=30)
    turn = table.turn()
    payload, gradients = table.server.model(turn)
    table.desk.answer(turn, payload)
    table.desk.send(turn.task)
    message = table.ears.receive(DEADLINE_S)
    assert message is not None
    average, header = read_model(message.payload, table.shapes, FLOAT32)
    assert {float(value) for tensor in average.values() for value in tensor.ravel()} == {4.0}
    assert header.rewards == {1: (1, 100.0), 2: (1, 200.0)}
    assert (header.task, header.agent, header.round, header.reward, header.samples) == (1, 0, 1, 150.0, 40)
    assert gradients == 0


def test_a_robot_ahead_of_its_cluster_is_kept_and_what_is_old_left_out(table: Table) -> None:
    table.send(1, 1)
    table.send(1, 2)
    table.send(2, 1)
    first = table.turn()
    table.desk.answer(first, table.server.model(first)[0])
    table.send(1, 1)  # a duplicate, come late
    table.send(2, 2)
    assert table.turn().round == 2
    assert table.desk.refused == 0


@pytest.mark.parametrize(
    "wrong", [{"round_": 3}, {"task": 2}, {"agent": 2}, {"samples": 0}, {"rewards": {}}], ids=lambda each: str(each)
)
def test_what_is_not_a_robots_next_round_is_refused_and_counted(table: Table, wrong: dict[str, object]) -> None:
    table.send(1, **{"round_": 1, **wrong})  # type: ignore[arg-type]
    table.send(1, 1)
    table.send(2, 1)
    assert table.turn().task == 1
    assert table.desk.refused == 1


def test_a_model_that_was_lost_is_sent_again_when_asked_for(table: Table) -> None:
    table.send(1, 1)
    table.send(2, 1)
    turn = table.turn()
    table.desk.answer(turn, b"model")
    table.ears.subscribe(topics.cluster_model(RUN, "fedavg", 1))
    for round_ in (7, 1):  # a round that is not at hand is not answered
        request = encode_json(RoundRequest(first=round_, last=round_))
        table.robots.publish(topics.model_again(RUN, "fedavg", 1), request)
    table.present(*ROBOTS, stage=DONE)
    assert table.desk.next_round() is None
    message = table.ears.receive(0)
    assert message is not None
    assert message.payload == b"model"
    assert table.ears.receive(0.001) is None


def test_who_has_come_but_not_sent_is_asked_again_until_all_are_done(make_scenario: Make) -> None:
    table = Table(make_scenario(methods=["fedavg"], bus={"resend_after_s": 0.01}))
    table.ears.subscribe(*(topics.resend(RUN, "fedavg", ROBOTS[agent], agent) for agent in ROBOTS))
    table.present(1, stage=1)
    table.present(3, 4, 5, 6, stage=DONE)
    ended = threading.Thread(target=table.desk.next_round, daemon=True)
    ended.start()
    message = table.ears.receive(DEADLINE_S)
    assert message is not None
    assert message.topic == topics.resend(RUN, "fedavg", 1, 1)  # not robot 2, which has not come
    assert decode_json(message.payload, RoundRequest) == RoundRequest(first=1, last=1)
    table.present(1, 2, stage=DONE)
    ended.join(DEADLINE_S)
    assert not ended.is_alive()


def motions(scenario: Scenario, agent: int) -> list[bytes]:
    rng = np.random.default_rng(agent)
    return [
        encode_motion(
            rng.integers(0, 256, (12, 16, 4), dtype=np.uint8),
            MotionHeader(
                task=1, agent=agent, round=1, motion=index, action=index % 4, reward=1.0, first=index == 0,
                terminated=False,
            ),
        )
        for index in range(scenario.learning.motions_per_round)
    ]  # fmt: skip


def test_the_data_center_learns_as_many_batches_as_the_robots_would_have_whoever_came_first(
    make_scenario: Make,
) -> None:
    scenario = make_scenario(methods=["centralized"], learning={"batches_per_round": 5, "batch_size": 4})
    arrived = {
        agent: [read_motion(each, scenario, Raw("uint8")) for each in motions(scenario, agent)] for agent in (1, 2)
    }
    backwards = dict(reversed(arrived.items()))
    (ours, gradients), (theirs, _) = (
        ExperienceService(scenario, CENTRALIZED).model(Turn(1, 1, order)) for order in (arrived, backwards)
    )
    assert gradients == 2 * 5
    assert ours == theirs


def test_the_data_center_takes_no_motion_of_another_robot(make_scenario: Make) -> None:
    scenario = make_scenario(methods=["centralized"])
    learner = ExperienceService(scenario, CENTRALIZED)
    assert learner.read(motions(scenario, 2)[3], 1, 2)[:2] == (1, 3)
    with pytest.raises(PayloadError, match="experience of robot 2, task 1; expected robot 1, task 1"):
        learner.read(motions(scenario, 2)[3], 1, 1)


@pytest.mark.parametrize(("round_", "told"), [(3, True), (2, False)])
def test_a_robot_more_than_two_rounds_ahead_has_been_here_with_this_data_center(
    make_scenario: Make, round_: int, told: bool
) -> None:
    table = Table(make_scenario(methods=["fedavg"], bus={"resend_after_s": 0.01}))
    table.present(*ROBOTS, stage=1)
    table.ears.subscribe(topics.wait(RUN, "agent-1"))
    errors: list[BaseException] = []

    def serve() -> None:
        try:
            table.desk.next_round()
        except RunError as error:
            errors.append(error)

    serving = threading.Thread(target=serve, daemon=True)
    serving.start()
    asked = table.ears.receive(DEADLINE_S)
    assert asked is not None
    assert "round 1 of robots [1, 2]" in decode_json(asked.payload, Wait).what
    answer = Wait(client="agent-1", stage=1, round=round_)
    table.robots.publish(topics.wait(RUN, "datacenter"), encode_json(answer))
    if not told:
        table.present(*ROBOTS, stage=DONE)
    serving.join(DEADLINE_S)
    assert not serving.is_alive()
    expected = (
        ["agent-1 is in round 3 of fedavg already, and the data center comes with 0 rounds of it"] if told else []
    )
    assert [str(error).split(":")[0] for error in errors] == expected
