"""A robot's gradient steps, on a linear Q-function small enough to follow by hand.

One pixel of value 192 is x = (1, 1, 1, 1) for the network: Q(x, a) = sum of the row a of the weights + bias a.
"""

import math

import numpy as np
import numpy.typing as npt
import pytest
import torch

from jouleswarm.common.errors import TrainingError
from jouleswarm.common.scenario.sections import Learning, Network
from jouleswarm.learning.learner import Learner
from jouleswarm.learning.networks import to_weights
from tests.made_up import qnetwork

LINEAR = Network(width=1, height=1, conv=(), dense=())
ONES = np.full((1, 1, 4), 192, np.uint8)
Weights = dict[str, npt.NDArray[np.float32]]


def zeros() -> Weights:
    return {"1.weight": np.zeros((4, 4), np.float32), "1.bias": np.zeros(4, np.float32)}


def settings(**fields: object) -> Learning:
    plain = {"optimizer": "sgd", "lr": 0.1, "batch_size": 4, "replay_size": 8, "discount": 0.5, "grad_clip": 100.0}
    return Learning.model_validate({**plain, **fields})


def learner(weights: Weights | None = None, network: Network = LINEAR, **fields: object) -> Learner:
    return Learner(qnetwork(network), settings(**fields), weights or zeros(), np.random.default_rng(1))


def q_of(robot: Learner) -> list[float]:
    return robot.q_values(ONES).tolist()


def test_one_step_by_hand() -> None:
    robot = learner()
    robot.replay.observe(ONES, first=True)
    robot.replay.act(2, 3.0, terminated=True)
    assert robot.learn(1) == 1
    # Q = 0, target 3: slope of the Huber loss -1 on each of 4 weights and the bias; SGD of 0.1
    weights = robot.weights()
    assert weights["1.weight"].tolist() == [[0.0] * 4, [0.0] * 4, pytest.approx([0.1] * 4), [0.0] * 4]
    assert q_of(robot) == pytest.approx([0.0, 0.0, 0.5, 0.0])


def test_gradients_are_clipped_by_their_common_norm() -> None:
    robot = learner(grad_clip=1.0)
    robot.replay.observe(ONES, first=True)
    robot.replay.act(2, 3.0, terminated=True)
    robot.learn(1)
    # five slopes of -1 have norm sqrt(5): each becomes 1/sqrt(5), Q = 5 x 0.1/sqrt(5)
    assert q_of(robot)[2] == pytest.approx(0.5 / math.sqrt(5), rel=1e-4)


def test_the_target_follows_by_its_rate_and_the_next_value_comes_from_it() -> None:
    robot = learner(target_polyak=0.5)
    robot.replay.observe(ONES, first=True)
    robot.replay.act(0, 2.0, terminated=False)
    robot.replay.observe(ONES, first=False)  # the transition leads to itself
    robot.learn(1)
    # step 1: target 2 + 0.5 x 0; Q(0) -> 0.5; q~ -> half of it, 0.25
    assert q_of(robot)[0] == pytest.approx(0.5)
    robot.learn(1)
    # step 2: target 2 + 0.5 x 0.25 = 2.125, error 1.625 > 1: another 0.5
    assert q_of(robot)[0] == pytest.approx(1.0)
    robot.learn(1)
    # step 3: q~ = 0.25 + 0.5 x (1 - 0.25) = 0.625; target 2.3125, error 1.3125 > 1: 1.5
    assert q_of(robot)[0] == pytest.approx(1.5)
    robot.learn(1)
    # step 4: q~ = 0.625 + 0.5 x (1.5 - 0.625) = 1.0625; target 2.53125, error 1.03125: 2
    robot.learn(1)
    # step 5: q~ = 1.0625 + 0.5 x (2 - 1.0625) = 1.53125; target 2.765625, error 0.765625 < 1: 5 x 0.1 x 0.765625 more
    assert q_of(robot)[0] == pytest.approx(2.0 + 0.3828125)


def with_values(*values: float) -> Weights:
    return {**zeros(), "1.bias": np.array(values, np.float32)}


@pytest.mark.parametrize(("double", "goal"), [(True, 0.5 * 1.0), (False, 0.5 * 4.0)])
def test_double_learning_asks_the_target_what_the_online_choice_is_worth(double: bool, goal: float) -> None:
    robot = learner(with_values(4.0, 1.0, 0.0, 0.0), double=double, target_polyak=1e-9)
    robot.set_weights(with_values(0.0, 3.0, 0.0, 0.2))  # online prefers action 1, which the target values at 1
    robot.replay.observe(ONES, first=True)
    robot.replay.act(3, 0.0, terminated=False)
    robot.replay.observe(ONES, first=False)
    robot.learn(1)
    error = goal - 0.2
    assert q_of(robot)[3] == pytest.approx(0.2 + 0.5 * min(1.0, error))


def test_nothing_is_learned_from_an_empty_memory() -> None:
    robot = learner()
    robot.replay.observe(ONES, first=True)  # no whole transition yet
    assert robot.learn(5) == 0
    assert robot.steps == 0
    assert q_of(robot) == [0.0] * 4


def remember_some(robot: Learner) -> None:
    rng = np.random.default_rng(3)
    for _ in range(8):
        robot.replay.observe(rng.integers(0, 256, (12, 16, 4), dtype=np.uint8), first=False)
        robot.replay.act(int(rng.integers(4)), float(rng.normal()), terminated=bool(rng.random() < 0.2))


TINY = Network(width=16, height=12, conv=((8, 4, 2), (16, 3, 1)), dense=(32,))


def start(seed: int = 1) -> Weights:
    return to_weights(qnetwork(TINY, seed))


def test_as_many_gradients_are_computed_as_are_told() -> None:
    robot = learner(start(), TINY)
    remember_some(robot)
    assert [robot.learn(3), robot.learn(4)] == [3, 4]
    assert robot.steps == 7


def test_targets_computed_in_one_batch_learn_the_same() -> None:
    # The target rests for 4 steps: learn(4) computes its values in one batch; 4 x learn(1) does not.
    together, apart = (learner(start(), TINY, target_every=4, optimizer="adam", lr=1e-3) for _ in range(2))
    remember_some(together)
    remember_some(apart)
    together.learn(4)
    for _ in range(4):
        apart.learn(1)
    for name, tensor in together.weights().items():
        np.testing.assert_allclose(tensor, apart.weights()[name], rtol=0, atol=1e-6)


def test_a_target_that_moves_in_between_is_not_computed_in_one_batch() -> None:
    robot = learner(target_every=2, target_polyak=1.0)
    robot.replay.observe(ONES, first=True)
    robot.replay.act(0, 2.0, terminated=False)
    robot.replay.observe(ONES, first=False)
    robot.learn(5)
    # Q(0) 0.5, 1 (q~ = 1: target 2.5), 1.5, 2 (q~ = 2: target 3, error 1), 2.5
    assert q_of(robot)[0] == pytest.approx(2.5)
    robot.learn(1)
    # still q~ = 2, target 3, error 0.5 < 1
    assert q_of(robot)[0] == pytest.approx(2.75)


def test_mixed_weights_are_taken_and_the_target_stays() -> None:
    robot = learner(with_values(1.0, 0.0, 0.0, 0.0), target_polyak=1e-9)
    robot.set_weights(with_values(0.0, 5.0, 0.0, 0.0))
    assert q_of(robot) == [0.0, 5.0, 0.0, 0.0]
    robot.replay.observe(ONES, first=True)
    robot.replay.act(2, 0.0, terminated=False)
    robot.replay.observe(ONES, first=False)
    robot.learn(1)
    # online choice is action 1; the old target values it at 0: target 0, Q(2) = 0 stays
    assert q_of(robot)[2] == 0.0


def test_weights_handed_out_do_not_follow_the_learner() -> None:
    robot = learner(start(), TINY)
    remember_some(robot)
    before = robot.weights()
    copies = {name: tensor.copy() for name, tensor in before.items()}
    robot.learn(3)
    assert all(np.array_equal(before[name], copies[name]) for name in copies)
    assert not np.array_equal(robot.weights()["0.weight"], before["0.weight"])


def test_the_same_start_and_stream_learn_the_same_to_the_bit() -> None:
    results = []
    for torch_seed in (1, 2):
        torch.manual_seed(torch_seed)  # must not matter
        robot = learner(start(), TINY, optimizer="adam")
        remember_some(robot)
        robot.learn(5)
        results.append(b"".join(tensor.tobytes() for tensor in robot.weights().values()))
    assert results[0] == results[1]


def test_a_loss_that_is_not_finite_ends_learning_with_a_clear_error() -> None:
    robot = learner()
    robot.replay.observe(ONES, first=True)
    robot.replay.act(2, math.inf, terminated=True)
    with pytest.raises(TrainingError, match=r"loss is not finite after 2 gradient steps; lower learning\.lr"):
        robot.learn(2)
