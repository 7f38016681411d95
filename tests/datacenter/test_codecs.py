"""The data center takes the scenario's codecs and refuses others."""

from collections.abc import Callable

import numpy as np
import pytest

from jouleswarm.codecs.codec import codec_of
from jouleswarm.codecs.frames import resize
from jouleswarm.codecs.observations import encode_experience, experience_codec_of
from jouleswarm.codecs.streams import WeightsEncoder
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import ModelHeader, MotionHeader
from jouleswarm.common.wire.models import encode_model
from jouleswarm.datacenter.experience import read_motion
from jouleswarm.datacenter.services import WeightsService
from jouleswarm.learning.networks import build_qnetwork, to_weights

CODECS: tuple[str, ...] = ("float32", "float16", "int8", "topk")
EXPERIENCE: tuple[str, ...] = ("raw", "png", "resized")
FEDAVG = Arm("fedavg", "fedavg", 0)
HEADER = ModelHeader(task=1, agent=1, round=1, reward=1.0, samples=20, rewards={1: (1, 1.0)})
MOTION = MotionHeader(task=1, agent=1, round=1, motion=0, action=0, reward=0, first=True, terminated=False)
FRAME = np.random.default_rng(1).integers(0, 256, (12, 16, 4), dtype=np.uint8)

MakeScenario = Callable[..., Scenario]


@pytest.mark.parametrize("codec", CODECS)
def test_the_parameter_server_takes_weights_of_its_codec_alone(make_scenario: MakeScenario, codec: str) -> None:
    scenario = make_scenario(federation={"codec": codec}, methods=["fedavg"])
    server, weights = WeightsService(scenario, FEDAVG), to_weights(build_qnetwork(scenario, 1))
    for sent in CODECS:
        payload = WeightsEncoder(codec_of(make_scenario(federation={"codec": sent}))).payload(weights, HEADER)
        if sent == codec:
            assert server.read(payload, 1, 1)[:2] == (1, 0)
        else:
            with pytest.raises(PayloadError, match=codec):
                server.read(payload, 1, 1)


def test_a_first_round_of_differences_is_refused_before_it_can_do_harm(make_scenario: MakeScenario) -> None:
    scenario = make_scenario(federation={"codec": "topk"}, methods=["fedavg"])
    weights = to_weights(build_qnetwork(scenario, 1))
    encoder = WeightsEncoder(codec_of(scenario))
    _, differences = encoder.encode(weights), encoder.encode(weights)
    payload = encode_model(differences, HEADER.model_copy(update={"codec": "topk"}))
    with pytest.raises(PayloadError, match="expected a whole model in the first round"):
        WeightsService(scenario, FEDAVG).read(payload, 1, 1)


@pytest.mark.parametrize("codec", EXPERIENCE)
def test_experience_of_the_scenarios_codec_alone_becomes_the_frame_that_is_learned_from(
    make_scenario: MakeScenario, codec: str
) -> None:
    scenario = make_scenario(meta={"experience_codec": codec})
    expected = experience_codec_of(scenario)
    for sent in EXPERIENCE:
        payload = encode_experience(FRAME, MOTION, experience_codec_of(make_scenario(meta={"experience_codec": sent})))
        if sent == codec:
            motion = read_motion(payload, scenario, expected)
            assert np.array_equal(motion.frame, resize(FRAME, 8, 6))
            assert motion.payload_bytes == len(payload)
        else:
            with pytest.raises(PayloadError, match="motion"):
                read_motion(payload, scenario, expected)
