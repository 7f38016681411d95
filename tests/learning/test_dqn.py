"""Temporal-difference targets, Huber loss, exploration and target tracking, against values worked out by hand."""

import numpy as np
import pytest
import torch

from jouleswarm.learning.dqn import epsilon_greedy, polyak_update, td_loss, td_target

REWARD = torch.tensor([1.0, 2.0, 3.0])
TERMINATED = torch.tensor([0.0, 0.0, 1.0])
NEXT_Q = torch.tensor([[1.0, 5.0], [4.0, 0.0], [9.0, 8.0]])
NEXT_Q_TARGET = torch.tensor([[10.0, 20.0], [30.0, 40.0], [70.0, 80.0]])


def test_double_learning_takes_the_target_networks_value_of_the_online_networks_choice() -> None:
    target = td_target(REWARD, TERMINATED, NEXT_Q, NEXT_Q_TARGET, 0.5, double=True)
    # chosen: actions 1, 0; values 20, 30; the third ended: 1 + 10, 2 + 15, 3
    assert target.tolist() == [11.0, 17.0, 3.0]


def test_plain_learning_takes_the_target_networks_best_value() -> None:
    target = td_target(REWARD, TERMINATED, NEXT_Q, NEXT_Q_TARGET, 0.5, double=False)
    assert target.tolist() == [11.0, 22.0, 3.0]  # 2 + 0.5 x 40


def test_without_discount_only_the_reward_is_left() -> None:
    assert td_target(REWARD, TERMINATED, NEXT_Q, NEXT_Q_TARGET, 0.0, double=True).tolist() == [1.0, 2.0, 3.0]


def test_huber_loss_is_quadratic_below_1_and_linear_above() -> None:
    q = torch.tensor([[1.0, 2.0], [3.0, 4.0]])
    # errors 0.5 and 3: (0.5^2 / 2 + (3 - 0.5)) / 2 = (0.125 + 2.5) / 2
    assert td_loss(q, torch.tensor([1, 0]), torch.tensor([2.5, 0.0])).item() == pytest.approx(1.3125)


def test_loss_moves_only_the_value_of_the_action_taken() -> None:
    q = torch.tensor([[1.0, 2.0, 3.0]], requires_grad=True)
    td_loss(q, torch.tensor([1]), torch.tensor([10.0])).backward()
    assert q.grad is not None
    assert q.grad.tolist() == [[0.0, -1.0, 0.0]]  # error -8, beyond delta = 1: slope -1


def test_epsilon_0_always_takes_the_best_action() -> None:
    rng = np.random.default_rng(1)
    q = torch.tensor([0.0, -1.0, 7.0, 6.9])
    assert {epsilon_greedy(q, 0.0, rng) for _ in range(200)} == {2}


def test_epsilon_1_takes_every_action_about_equally_often() -> None:
    rng = np.random.default_rng(1)
    counts = np.bincount([epsilon_greedy(torch.tensor([9.0, 0.0, 0.0, 0.0]), 1.0, rng) for _ in range(4000)])
    assert counts.min() > 850  # 1000 each, standard deviation 27
    assert counts.max() < 1150


def test_epsilon_is_the_share_of_random_actions() -> None:
    rng = np.random.default_rng(2)
    chosen = [epsilon_greedy(torch.tensor([0.0, 0.0, 1.0, 0.0]), 0.4, rng) for _ in range(5000)]
    others = sum(action != 2 for action in chosen)
    assert 1350 < others < 1650  # 0.4 x 3/4 x 5000 = 1500, standard deviation 32


def test_polyak_update_goes_that_share_of_the_way_in_place() -> None:
    target, online = torch.tensor([0.0, 10.0]), torch.tensor([10.0, 0.0])
    polyak_update([target], [online], 0.3)
    assert target.tolist() == pytest.approx([3.0, 7.0])
    assert online.tolist() == [10.0, 0.0]


def test_polyak_rate_1_copies() -> None:
    target, online = torch.tensor([0.1, 123.456]), torch.tensor([7.7, -3.3])
    polyak_update([target], [online], 1.0)
    assert torch.equal(target, online)
