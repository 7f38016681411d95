"""Consensus, eq. (6), against values worked out by hand."""

import itertools

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.codecs.codec import Codec, share_of
from jouleswarm.codecs.floats import Float16
from jouleswarm.codecs.int8 import Int8
from jouleswarm.codecs.streams import WeightsEncoder
from jouleswarm.codecs.topk import TopK
from jouleswarm.methods.mixing import default_step, mix, mixing_weights

Model = dict[str, npt.NDArray[np.float32]]


def model(*values: float) -> Model:
    return {"w": np.array(values, np.float32)}


def test_neighbours_count_by_their_new_samples() -> None:
    assert mixing_weights({2: 10, 3: 30}) == {2: 0.25, 3: 0.75}
    assert mixing_weights({7: 20}) == {7: 1.0}


@given(st.dictionaries(st.integers(1, 50), st.integers(1, 10_000), min_size=1, max_size=10))
def test_mixing_weights_sum_to_1(samples: dict[int, int]) -> None:
    assert sum(mixing_weights(samples).values()) == pytest.approx(1.0)


def test_the_default_step_is_one_over_the_closed_neighbourhood() -> None:
    assert [default_step(neighbours) for neighbours in (0, 1, 3)] == [1.0, 0.5, 0.25]
    assert default_step(1, share=0.05) == 0.025  # of the entries, a twentieth is heard of in each round


def test_the_literal_step_makes_two_robots_swap_their_models() -> None:
    ours, theirs = model(1.0, 2.0), model(5.0, -4.0)
    assert mix(ours, {2: theirs}, {2: 1.0}, 1.0)["w"].tolist() == [5.0, -4.0]
    assert mix(theirs, {1: ours}, {1: 1.0}, 1.0)["w"].tolist() == [1.0, 2.0]


def test_a_half_step_makes_two_robots_meet_half_way() -> None:
    ours, theirs = model(1.0, 2.0), model(5.0, -4.0)
    assert mix(ours, {2: theirs}, {2: 1.0}, 0.5)["w"].tolist() == [3.0, -1.0]
    assert mix(theirs, {1: ours}, {1: 1.0}, 0.5)["w"].tolist() == [3.0, -1.0]


def test_three_robots_mix_all_neighbours_at_once() -> None:
    # 4 + 1/2 x (1/4 x (8 - 4) + 3/4 x (0 - 4)) = 4 + 1/2 x (1 - 3) = 3
    assert mix(model(4.0), {2: model(8.0), 3: model(0.0)}, {2: 0.25, 3: 0.75}, 0.5)["w"].tolist() == [3.0]


def test_neighbours_are_mixed_against_what_they_hold_of_this_robot() -> None:
    # 4 + 1/2 x (1/4 x (8 - 5) + 3/4 x (0 - 5)) = 4 + 1/2 x (3/4 - 15/4) = 2.5
    mixed = mix(model(4.0), {2: model(8.0), 3: model(0.0)}, {2: 0.25, 3: 0.75}, 0.5, told=model(5.0))
    assert mixed["w"].tolist() == [2.5]


def test_a_robot_keeps_the_precision_that_its_message_had_not() -> None:
    # both say 1.0, and mean 1.0 and a little more or less
    little = np.float32(2.0**-23)
    assert mix(model(1.0 + little), {2: model(1.0)}, {2: 1.0}, 0.5, told=model(1.0))["w"].tolist() == [1.0 + little]


@pytest.mark.parametrize("codec", [Float16(), Int8(), TopK(0.05)], ids=lambda codec: codec.name)
def test_two_robots_that_mix_by_a_lossy_codec_come_together_at_their_mean(codec: Codec) -> None:
    distance, centre = distances(codec, default_step(1, share_of(codec)), rounds=400)
    # steps of 1/127 of the largest weight, about 3, are not told apart; float16 and topk tell smaller ones
    assert distance[-1] < (3 / 127 if codec.name == "int8" else 1e-3 * distance[0])
    assert centre < 1e-5


def test_with_few_entries_a_message_the_full_step_drives_robots_apart() -> None:
    distance, _ = distances(TopK(0.05), default_step(1), rounds=40)
    assert distance[-1] > 100 * distance[0]


def distances(codec: Codec, step: float, rounds: int) -> tuple[list[float], float]:
    """How far two robots that learn nothing are apart after each round, and how far their mean has moved."""
    rng = np.random.default_rng(1)
    models = [{"w": rng.normal(size=200).astype(np.float32)} for _ in range(2)]
    centre = (models[0]["w"] + models[1]["w"]) / 2
    encoders, apart = [WeightsEncoder(codec), WeightsEncoder(codec)], []
    for _ in range(rounds):
        apart.append(float(np.abs(models[0]["w"] - models[1]["w"]).max()))
        for encoder, own in zip(encoders, models, strict=True):
            encoder.encode(own)
        public = [encoder.public for encoder in encoders]
        models = [mix(models[k], {1 - k: public[1 - k]}, {1 - k: 1.0}, step, public[k]) for k in (0, 1)]
    return apart, float(np.abs((models[0]["w"] + models[1]["w"]) / 2 - centre).max())


def test_without_neighbours_the_model_stays() -> None:
    assert mix(model(1.0, 2.0), {}, {}, 1.0)["w"].tolist() == [1.0, 2.0]


def test_every_tensor_is_mixed_in_its_own_shape() -> None:
    ours = {"a": np.zeros((2, 3), np.float32), "b": np.ones(4, np.float32)}
    theirs = {"a": np.full((2, 3), 2, np.float32), "b": np.full(4, 3, np.float32)}
    mixed = mix(ours, {9: theirs}, {9: 1.0}, 0.5)
    assert list(mixed) == ["a", "b"]
    assert np.array_equal(mixed["a"], np.full((2, 3), 1.0))
    assert np.array_equal(mixed["b"], np.full(4, 2.0))
    assert {tensor.dtype for tensor in mixed.values()} == {np.dtype(np.float32)}


def test_inputs_are_left_as_they_were() -> None:
    ours, theirs = model(1.0, 2.0), model(5.0, -4.0)
    for tensor in (ours["w"], theirs["w"]):
        tensor.setflags(write=False)  # as decoded payloads are
    mixed = mix(ours, {2: theirs}, {2: 1.0}, 0.5)
    assert ours["w"].tolist() == [1.0, 2.0]
    assert theirs["w"].tolist() == [5.0, -4.0]
    assert not np.shares_memory(mixed["w"], ours["w"])


def test_the_result_is_the_same_to_the_bit_whoever_came_first() -> None:
    rng = np.random.default_rng(1)
    models = {agent: {"w": rng.normal(size=50).astype(np.float32)} for agent in (1, 2, 3, 4, 5)}
    sigma = mixing_weights({2: 3, 3: 5, 4: 7, 5: 11})
    results = {
        mix(models[1], {agent: models[agent] for agent in order}, sigma, 0.2)["w"].tobytes()
        for order in itertools.permutations((2, 3, 4, 5))
    }
    assert len(results) == 1


@given(st.lists(st.floats(-100, 100, width=32), min_size=3, max_size=3), st.floats(0.01, 0.5))
def test_a_fully_linked_cluster_keeps_its_average_and_comes_closer(values: list[float], step: float) -> None:
    models = {agent: model(value) for agent, value in enumerate(values)}
    mixed = []
    for agent in models:
        others = {each: models[each] for each in models if each != agent}
        mixed.append(float(mix(models[agent], others, mixing_weights(dict.fromkeys(others, 20)), step)["w"][0]))
    assert sum(mixed) == pytest.approx(sum(values), abs=1e-3)
    assert max(mixed) - min(mixed) <= max(values) - min(values) + 1e-4
