"""The data center's services: a task's state is written to a file, read into a new service, and goes on the same."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jouleswarm.codecs.codec import codec_of
from jouleswarm.codecs.models import read_model
from jouleswarm.codecs.streams import WeightsDecoder, WeightsEncoder
from jouleswarm.common.bus.bus import MemoryHub
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.disk.state import State
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import ModelHeader, RoundRequest, encode_json
from jouleswarm.datacenter.checkpoint import forget
from jouleswarm.datacenter.cluster_rounds import ClusterDesk, Service, Turn
from jouleswarm.datacenter.services import ExperienceService, WeightsService
from jouleswarm.learning.networks import build_qnetwork, shapes_of, to_weights

Make = Callable[..., Any]
CODECS: tuple[str, ...] = ("float32", "float16", "int8", "topk")
ROBOTS = (1, 2)  # of task 1
FEDAVG, CENTRALIZED = (Arm(name, name, 0) for name in ("fedavg", "centralized"))


def through_a_file(ours: Service[Any], theirs: Service[Any], folder: Path) -> None:
    file = StateFile(folder / "s.safetensors", "o")
    file.save(State.of(ours.kept(1)))
    state = file.load()
    assert state is not None
    state.into(theirs.kept(1))


class Robots:
    """Two robots of federated averaging that drift."""

    def __init__(self, scenario: Scenario) -> None:
        self.codec, self.rng = codec_of(scenario), np.random.default_rng(1)
        network = build_qnetwork(scenario, 1)
        self.shapes, self.models = shapes_of(network), {robot: to_weights(network) for robot in ROBOTS}
        self.encoders = {robot: WeightsEncoder(self.codec) for robot in ROBOTS}
        self.decoder = WeightsDecoder(self.codec, self.shapes)

    def say(self, round_: int) -> dict[int, bytes]:
        said = {}
        for robot, model in self.models.items():
            for name, tensor in model.items():
                model[name] = tensor + self.rng.normal(0, 0.1, tensor.shape).astype(np.float32)
            header = ModelHeader(
                task=1, agent=robot, round=round_, reward=1.0, samples=10 * robot, rewards={robot: (round_, round_ / 3)}
            )
            said[robot] = self.encoders[robot].payload(model, header, 2)
        return said

    def hear(self, answer: bytes) -> None:
        average = self.decoder.decode(read_model(answer, self.shapes, self.codec)[0])
        for robot in ROBOTS:
            self.encoders[robot].rebase(average)
            self.models[robot] = dict(average)


def answer(server: WeightsService, round_: int, said: dict[int, bytes]) -> bytes:
    arrived = {robot: server.opened(robot, [server.read(payload, 1, robot)[2]]) for robot, payload in said.items()}
    return server.model(Turn(1, round_, arrived))[0]


@pytest.mark.parametrize("codec", CODECS)
def test_a_parameter_server_goes_on_bit_by_bit(codec: str, make_scenario: Make, tmp_path: Path) -> None:
    federation = {"codec": codec, "topk_share": 0.1, "reward_window": 2}
    scenario = make_scenario(methods=["fedavg"], federation=federation)
    robots, ours, theirs = Robots(scenario), WeightsService(scenario, FEDAVG), WeightsService(scenario, FEDAVG)
    for round_ in (1, 2):
        robots.hear(answer(ours, round_, robots.say(round_)))
    through_a_file(ours, theirs, tmp_path)
    for round_ in (3, 4):
        said = robots.say(round_)
        undisturbed = answer(ours, round_, said)
        assert answer(theirs, round_, said) == undisturbed
        robots.hear(undisturbed)


@pytest.mark.parametrize("codec", CODECS)
def test_a_central_learner_goes_on_bit_by_bit(
    codec: str, make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    scenario = make_scenario(
        methods=["centralized"], federation={"codec": codec},
        learning={"batches_per_round": 3, "batch_size": 4, "replay_size": 5},  # 10 for two robots: round 3 wraps
    )  # fmt: skip

    def turn(round_: int) -> Turn[Any]:
        motions = [make_experience(scenario, seed)[1][0] for seed in (round_, round_ + 100)]
        return Turn(1, round_, dict(zip(ROBOTS, motions, strict=True)))

    ours = ExperienceService(scenario, CENTRALIZED, tmp_path / "a")
    for round_ in (1, 2):
        ours.model(turn(round_))
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    theirs = ExperienceService(scenario, CENTRALIZED, tmp_path / "b")
    through_a_file(ours, theirs, tmp_path / "a")
    for round_ in (3, 4):
        assert theirs.model(turn(round_)) == ours.model(turn(round_))


def test_a_desk_goes_on_with_the_next_round_and_the_last_answer(make_scenario: Make) -> None:
    scenario, hub = make_scenario(methods=["fedavg"]), MemoryHub()
    robots, server = hub.connect("robots"), WeightsService(scenario, FEDAVG)

    def desk(name: str) -> ClusterDesk[Any]:
        return ClusterDesk(Listener(hub.connect(name), 60.0), scenario, "r", "fedavg", server, 2)

    first, second = desk("datacenter"), desk("datacenter again")
    first.answer(Turn(1, 1, {}), b"answer")
    second.load_state(1, first.state(1))
    second.listen()
    robots.subscribe(topics.cluster_model("r", "fedavg", 1))
    robots.publish(topics.model_again("r", "fedavg", 1), encode_json(RoundRequest(first=1, last=1)))
    for robot, payload in Robots(scenario).say(2).items():
        robots.publish(topics.weights_up("r", "fedavg", 1, robot), payload)
    turn = second.next_round()
    assert turn is not None
    assert (turn.task, turn.round) == (1, 2)
    message = robots.receive(0.001)
    assert message is not None
    assert message.payload == b"answer"


def test_what_a_data_center_kept_is_gone_with_its_folder_and_nothing_of_others(tmp_path: Path) -> None:
    own = ("rounds.jsonl", "processor", ".lock", "counters.keys", "counters-0.bin", "recorder.handed-in")
    for folder in ("alone", "shared"):
        (tmp_path / folder).mkdir()
        for name in own:
            (tmp_path / folder / name).touch()
    (tmp_path / "shared" / "somebody-elses").touch()
    for folder in ("alone", "shared"):
        forget(tmp_path / folder, [])
    assert [path.name for path in tmp_path.iterdir()] == ["shared"]
    assert [path.name for path in (tmp_path / "shared").iterdir()] == ["somebody-elses"]
