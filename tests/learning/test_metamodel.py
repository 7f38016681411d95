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


def heads_of(ours: MetaModel, *values: float) -> None:
    """Biases of the heads of tasks 1, 2, ..."""
    with torch.no_grad():
        for name, leaf in ours.named():
            if name.endswith("/5.bias"):
                leaf.fill_(values[int(name[4]) - 1])


def test_as_an_unseen_task_it_starts_from_the_mean_of_the_others_heads() -> None:
    ours = model(1, 2, 3)
    heads_of(ours, 1.0, 2.0, 6.0)
    assert ours.params(1, unseen=True)["5.bias"].tolist() == [4.0] * 4  # (2 + 6) / 2
    assert ours.params(3, unseen=True)["5.bias"].tolist() == [1.5] * 4
    assert ours.params(1)["5.bias"].tolist() == [1.0] * 4


def test_as_an_unseen_task_its_gradient_goes_in_equal_shares_to_the_others_heads() -> None:
    ours = model(1, 2, 3)
    ours.zero_gradients()
    ours.add_gradient(1, gradient(ours, 1, 6.0), 1 / 3, unseen=True)
    ours.add_gradient(2, gradient(ours, 2, 12.0), 1 / 3, unseen=True)
    found = {name: leaf.grad.mean().item() for name, leaf in ours.named() if leaf.grad is not None}
    # 6 / 3 is task 1's: 1 each to the heads 2 and 3; 12 / 3 is task 2's: 2 each to the heads 1 and 3
    assert [found[f"task{task}/5.bias"] for task in (1, 2, 3)] == pytest.approx([2.0, 1.0, 3.0])
    assert found["0.weight"] == pytest.approx(2.0 + 4.0)


def test_learned_rates_begin_at_mu_and_stay_off_the_wire() -> None:
    ours = MetaModel(qnetwork(NETWORK, seed=1), (1, 2), 0.03)
    assert list(ours.rates) == ["log_mu/0", "log_mu/3", "log_mu/5"]  # conv, dense, dense
    assert [value.exp().item() for value in ours.rates.values()] == pytest.approx([0.03] * 3)
    assert ours.weights().keys() == model(1, 2).weights().keys()


def test_rates_get_their_share_of_every_tasks_gradient() -> None:
    ours = MetaModel(qnetwork(NETWORK, seed=1), (1, 2), 0.03)
    ours.zero_gradients()
    ours.add_gradient(1, {"log_mu/5": torch.tensor(4.0)}, 0.5)
    ours.add_gradient(2, {"log_mu/5": torch.tensor(8.0)}, 0.5, unseen=True)
    assert {name: leaf.grad.item() for name, leaf in ours.rates.items() if leaf.grad is not None} == {
        "log_mu/0": 0.0, "log_mu/3": 0.0, "log_mu/5": 6.0,
    }  # fmt: skip
