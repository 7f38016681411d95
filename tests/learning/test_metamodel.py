"""The meta-model's trunk and heads: whose gradient goes where, and what goes on the wire."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from jouleswarm.common.scenario.sections import Network
from jouleswarm.learning.metamodel import MetaModel
from tests.made_up import qnetwork

NETWORK = Network(width=4, height=4, conv=((2, 3, 1),), dense=(3,))


def model(*tasks: int) -> MetaModel:
    return MetaModel(qnetwork(NETWORK, seed=1), tasks)


def gradient(of: MetaModel, task: int, value: float) -> dict[str, torch.Tensor]:
    return {name: torch.full_like(tensor, value) for name, tensor in of.params(task).items()}


def test_a_tasks_gradient_goes_to_the_trunk_and_to_its_own_head_only() -> None:
    ours = model(1, 2)
    ours.zero_gradients()
    ours.add_gradient(1, gradient(ours, 1, 4.0), 0.5)
    ours.add_gradient(2, gradient(ours, 2, 8.0), 0.5)
    found = {name: leaf.grad.mean().item() for name, leaf in ours.named() if leaf.grad is not None}
    trunk = {name: value for name, value in found.items() if "/" not in name}
    assert set(trunk.values()) == {6.0}  # (4 + 8) / 2
    assert found["task1/5.weight"] == 2.0
    assert found["task2/5.weight"] == 4.0


def test_without_tasks_of_its_own_one_head_serves_all() -> None:
    ours = model()
    ours.zero_gradients()
    ours.add_gradient(1, gradient(ours, 1, 4.0), 0.5)
    ours.add_gradient(2, gradient(ours, 2, 8.0), 0.5)
    assert {leaf.grad.mean().item() for _, leaf in ours.named() if leaf.grad is not None} == {6.0}
    assert ours.weights().keys() == dict(qnetwork(NETWORK).named_parameters()).keys()


def test_on_the_wire_the_last_layer_is_the_heads_mean() -> None:
    ours = model(1, 2)
    leaves = dict(ours.named())
    with torch.no_grad():
        leaves["task1/5.bias"].fill_(1.0)
        leaves["task2/5.bias"].fill_(5.0)
    weights = ours.weights()
    assert weights["5.bias"].tolist() == [3.0] * 4
    assert weights["task2/5.bias"].tolist() == [5.0] * 4
    assert ours.params(1)["5.bias"].tolist() == [1.0] * 4


def test_what_went_on_the_wire_does_not_change_with_training() -> None:
    ours = model(1)
    sent = ours.weights()
    before = {name: value.copy() for name, value in sent.items()}
    with torch.no_grad():
        for _, leaf in ours.named():
            leaf.add_(1.0)
    assert all(np.array_equal(sent[name], before[name]) for name in sent)


@pytest.mark.parametrize("tasks", [(), (1, 2)])
def test_all_start_from_the_same_weights(tasks: tuple[int, ...]) -> None:
    start = {name: value.detach().numpy() for name, value in qnetwork(NETWORK, seed=1).named_parameters()}
    for name, value in model(*tasks).weights().items():
        assert np.array_equal(value, start[name.rpartition("/")[2]])
