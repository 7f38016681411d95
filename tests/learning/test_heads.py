"""Last layers of their own for training tasks, and what a robot starts from."""

from __future__ import annotations

from jouleswarm.common.scenario.sections import Network
from jouleswarm.learning.heads import head_key, head_of, meta_shapes, start_of
from jouleswarm.learning.networks import shapes_of
from tests.made_up import qnetwork

NETWORK = qnetwork(Network(width=8, height=6, conv=((4, 3, 1),), dense=(8,)))


def test_the_head_is_the_last_layer() -> None:
    assert head_of(NETWORK) == ("5.weight", "5.bias")  # conv, relu, flatten, dense, relu, dense


def test_a_meta_model_holds_the_network_and_a_head_for_each_training_task() -> None:
    shapes = meta_shapes(shapes_of(NETWORK), head_of(NETWORK), (1, 6))
    assert {name: shape for name, shape in shapes.items() if "/" in name} == {
        "task1/5.weight": (4, 8), "task1/5.bias": (4,), "task6/5.weight": (4, 8), "task6/5.bias": (4,),
    }  # fmt: skip
    assert {name: shape for name, shape in shapes.items() if "/" not in name} == shapes_of(NETWORK)


def test_a_robot_of_a_training_task_starts_from_its_own_head_others_from_the_mean() -> None:
    model = {
        "0.weight": "trunk",
        "5.weight": "mean",
        head_key(1, "5.weight"): "one",
        head_key(11, "5.weight"): "eleven",
    }
    assert start_of(model, 1) == {"0.weight": "trunk", "5.weight": "one"}
    assert start_of(model, 11) == {"0.weight": "trunk", "5.weight": "eleven"}
    assert start_of(model, 3) == {"0.weight": "trunk", "5.weight": "mean"}
