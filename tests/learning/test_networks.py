"""The Q-network's size, start and input."""

import numpy as np
import pytest
import torch
from gymnasium import spaces

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.sections import Network
from jouleswarm.learning.networks import load_weights, shapes_of, to_weights
from jouleswarm.learning.qnetwork import deepmind
from tests.made_up import qnetwork

TINY = Network(width=16, height=12, conv=((8, 4, 2), (16, 3, 1)), dense=(32,))


def test_the_papers_network_has_1391268_parameters() -> None:
    # 32 x (4 x 8 x 8 + 1) = 8224 -> 17 x 23; 64 x (32 x 4 x 4 + 1) = 32832 -> 7 x 10;
    # 64 x (64 x 3 x 3 + 1) = 36928 -> 5 x 8; 512 x (64 x 40 + 1) = 1311232; 4 x (512 + 1) = 2052
    model = qnetwork(Network())
    sizes = [sum(each.numel() for each in layer.parameters()) for layer in model]
    assert [size for size in sizes if size] == [8224, 32832, 36928, 1311232, 2052]
    assert sum(sizes) == 1_391_268
    assert sum(tensor.nbytes for tensor in to_weights(model).values()) == 5_565_072


def test_a_value_for_each_action_comes_out() -> None:
    frames, model = np.zeros((5, 72, 96, 4), np.uint8), qnetwork(Network())
    assert model(model.prepare(frames)).shape == (5, 4)


def test_the_same_seed_gives_the_same_weights_whatever_torch_drew_before() -> None:
    torch.manual_seed(1)
    first = to_weights(qnetwork(TINY, 5))
    torch.rand(17)
    second, other = to_weights(qnetwork(TINY, 5)), to_weights(qnetwork(TINY, 6))
    assert all(np.array_equal(first[name], second[name]) for name in first)
    assert all(not np.array_equal(first[name], other[name]) for name in first)


def test_weights_start_within_one_over_the_root_of_the_inputs() -> None:
    weights = to_weights(qnetwork(TINY, 1))
    conv = next(iter(weights.values()))
    assert conv.shape == (8, 4, 4, 4)
    assert 0.9 / 8 < np.abs(conv).max() <= 1 / 8  # 4 x 4 x 4 = 64 inputs


def test_observations_are_centred_and_channels_first() -> None:
    frames = np.zeros((1, 1, 2, 4), np.uint8)
    frames[0, 0, 1] = [128, 192, 255, 64]
    x = qnetwork(Network(width=2, height=1, conv=())).prepare(frames)
    assert (x.shape, x.dtype) == ((1, 4, 1, 2), torch.float32)
    assert x[0, :, 0, 0].tolist() == [-2.0] * 4  # (0 - 128) / 64
    assert x[0, :, 0, 1].tolist() == [0.0, 1.0, 127 / 64, -1.0]


def test_weights_loaded_are_the_weights_taken() -> None:
    source, copy = qnetwork(TINY, 1), qnetwork(TINY, 2)
    weights = to_weights(source)
    load_weights(copy, weights)
    assert all(np.array_equal(weights[name], tensor) for name, tensor in to_weights(copy).items())
    assert all(tensor.flags["C_CONTIGUOUS"] for tensor in weights.values())


def test_weights_taken_do_not_follow_the_model() -> None:
    model = qnetwork(TINY, 1)
    before = to_weights(model)
    kept = {name: tensor.copy() for name, tensor in before.items()}
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(1.0)
    assert all(np.array_equal(before[name], kept[name]) for name in kept)


def test_shapes_are_those_of_the_weights() -> None:
    model = qnetwork(TINY, 1)
    assert shapes_of(model) == {name: tensor.shape for name, tensor in to_weights(model).items()}


def test_a_network_that_does_not_fit_its_input_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"leaves nothing of network.width x network.height 6 x 6"):
        qnetwork(Network(width=6, height=6))
    box = spaces.Box(0, 255, (4, 6, 6), np.float32)
    with pytest.raises(ConfigurationError, match="kernel 8 stride 4 leaves nothing of 6 x 6"):
        deepmind(box, 4, Network())
