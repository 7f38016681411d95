"""The network door: networks by name, fed with whatever is observed, and refused where they do not fit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

import jouleswarm
from jouleswarm.codecs.observations import experience_codec_of
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import shipped_tensors
from jouleswarm.learning.heads import head_of
from jouleswarm.learning.networks import build_qnetwork, interface_of, to_weights, use_of

OWN = """
from torch import nn
from jouleswarm import QNetwork

class Block(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.inner, self.norm = nn.Linear(width, width), nn.LayerNorm(width)
    def forward(self, x):
        return x + self.norm(self.inner(x))

def build(observation, actions, settings):
    width = settings.kwargs.get("width", 8)
    model = QNetwork(nn.Flatten(), nn.Linear(observation.shape[0], width), nn.Tanh(), Block(width))
    model.append(nn.Linear(width, actions))
    model.shift, model.divisor = 1.0, 2.0
    return model

def more(observation, actions, settings): return QNetwork(nn.Linear(observation.shape[0], actions + 1))
def wrong(observation, actions, settings): return QNetwork(nn.Linear(9, actions))
def plain(observation, actions, settings): return nn.Sequential(nn.Linear(observation.shape[0], actions))
def luck(observation, actions, settings):
    return QNetwork(nn.Linear(observation.shape[0], 99), nn.Dropout(), nn.Linear(99, actions))
def norm(observation, actions, settings):
    return QNetwork(nn.Linear(observation.shape[0], 8), nn.BatchNorm1d(8), nn.Linear(8, actions))
def tail(observation, actions, settings): return QNetwork(nn.Linear(observation.shape[0], actions), nn.ReLU())
def half(observation, actions, settings): return QNetwork(nn.Linear(observation.shape[0], actions)).half()
def fails(observation, actions, settings): return settings.kwargs["depth"]
"""


def scenario(environment: str, folder: Path | None = None, **network: Any) -> Scenario:
    data = {
        "name": "t", "methods": ["fl"], "environment": environment, "tasks": [{"id": 1}],
        "network": {"dense": [6], "conv": [[4, 2, 1]], **network},
    }  # fmt: skip
    return scenario_from(data, "test", folder)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "own.py").write_text(OWN)
    return tmp_path


@pytest.mark.parametrize("world", ["Line", "Numbers", "Pictures"])
def test_the_default_is_by_what_is_observed_and_counted_without_it(world: str) -> None:
    settings = scenario(f"tests.worlds:{world}")
    kinds = [type(layer) for layer in build_qnetwork(settings)]
    vectors = [nn.Flatten, nn.Linear, nn.ReLU, nn.Linear]
    assert kinds == ([nn.Conv2d, nn.ReLU, *vectors] if world == "Pictures" else vectors)
    assert interface_of(settings) == shipped_tensors(settings.network, settings.spaces)


def test_vectors_are_fed_as_they_are() -> None:
    model = build_qnetwork(scenario("tests.worlds:Line"))
    batch = np.array([[1, 2, 3], [4, 5, 6]], np.float32)
    fed = model.prepare(batch)
    assert (fed.tolist(), fed.dtype) == (batch.tolist(), torch.float32)
    assert model(fed).shape == (2, 2)


def test_numbers_are_fed_one_hot() -> None:
    model = build_qnetwork(scenario("tests.worlds:Numbers"))
    assert model.prepare(np.array([0, 14])).tolist() == [[1.0] + [0.0] * 14, [0.0] * 14 + [1.0]]


def test_pictures_are_fed_centred_and_channels_first() -> None:
    model = build_qnetwork(scenario("tests.worlds:Pictures"))
    fed = model.prepare(np.full((1, 4, 6, 3), 192, np.uint8))
    assert fed.shape == (1, 3, 4, 6)
    assert set(fed.ravel().tolist()) == {1.0}  # (192 - 128) / 64


def test_a_network_of_ones_own_is_built_and_told(folder: Path) -> None:
    settings = scenario("tests.worlds:Line", folder, build="own:build", kwargs={"width": 5})
    model = build_qnetwork(settings, 1)
    assert isinstance(model, jouleswarm.QNetwork)
    assert head_of(model) == ("4.weight", "4.bias")
    batch = np.array([[3, 3, 3]], np.float32)
    assert model.prepare(batch).tolist() == [[1.0, 1.0, 1.0]]  # (3 - 1) / 2
    assert batch.tolist() == [[3, 3, 3]]
    told = use_of(settings)
    assert (told.input.subtract, told.input.divide, told.input.shape, told.input.layout) == (1.0, 2.0, (3,), "flat")
    assert [(layer.layer, layer.inputs, layer.outputs) for layer in told.network] == [
        ("flatten", None, None), ("linear", 3, 5), ("tanh", None, None), ("block", None, None), ("linear", 5, 2),
    ]  # fmt: skip
    assert [layer.module for layer in told.network][:3] == [None, None, "Tanh()"]
    sizes = [15, 5, 25, 5, 5, 5, 10, 2]
    assert interface_of(settings).entries == sizes


def test_its_weights_are_drawn_here_and_the_rest_is_as_built(folder: Path) -> None:
    settings = scenario("tests.worlds:Line", folder, build="own:build")
    torch.manual_seed(1)
    first = to_weights(build_qnetwork(settings, 5))
    torch.rand(3)
    again, other = to_weights(build_qnetwork(settings, 5)), to_weights(build_qnetwork(settings, 6))
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert not np.array_equal(first["3.inner.weight"], other["3.inner.weight"])
    assert first["3.norm.weight"].tolist() == [1.0] * 8
    assert np.abs(first["1.weight"]).max() <= 1 / np.sqrt(3)


@pytest.mark.parametrize(
    ("network", "message"),
    [
        ({"build": "own:more"}, r"gives torch.float32 \[2, 3\] for 2 observations, expected torch.float32 \[2, 2\]"),
        ({"build": "own:wrong"}, r"does not take observations of shape \[3\]: RuntimeError: mat1 and mat2"),
        ({"build": "own:plain"}, "gave a Sequential, expected a jouleswarm.QNetwork"),
        ({"build": "own:luck"}, "gives other values each time"),
        ({"build": "own:norm"}, "1.running_mean, 1.running_var, .* would not be sent"),
        ({"build": "own:tail"}, "its last child has no parameters"),
        ({"build": "own:half"}, "does not take observations"),
        ({"build": "own:fails"}, "network 'own:fails': KeyError: 'depth'"),
        ({"build": "own:bild"}, "has no bild; did you mean build"),
        ({"build": "mpl"}, "expected deepmind, mlp or module:name; did you mean mlp"),
        ({"build": "deepmind"}, r"deepmind takes images .*got observations \(3,\); expected network.build = \"mlp\""),
        ({"kwargs": {"width": 3}}, r"network.kwargs \['width'\]: mlp takes none"),
    ],
)
def test_a_network_that_does_not_fit_is_told_in_one_line(network: dict[str, Any], message: str, folder: Path) -> None:
    with pytest.raises(ConfigurationError, match=message) as caught:
        build_qnetwork(scenario("tests.worlds:Line", folder, **network))
    assert "\n" not in str(caught.value)


def test_images_that_the_convolutions_leave_nothing_of_are_told() -> None:
    with pytest.raises(ConfigurationError, match="kernel 5 stride 1 leaves nothing of 6 x 4"):
        build_qnetwork(scenario("tests.worlds:Pictures", conv=[[4, 5, 1]]))


def test_a_codec_for_images_is_refused_for_anything_else() -> None:
    settings = scenario("tests.worlds:Line")
    settings = settings.model_copy(update={"meta": settings.meta.model_copy(update={"experience_codec": "png"})})
    with pytest.raises(ConfigurationError, match=r"for images of 1, 3, 4 channels, the environment shows float"):
        experience_codec_of(settings)
