"""Optimizers: one step by hand, and many beside PyTorch's own classes."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from jouleswarm.learning.optimizers import Adam, Sgd

SHAPES = ((3, 5), (), (17,))


def parameters() -> list[Tensor]:
    generator = torch.Generator().manual_seed(0)
    return [torch.randn(shape, generator=generator).requires_grad_() for shape in SHAPES]


def test_a_first_step_of_adam_is_lr_against_the_sign_and_of_sgd_lr_times_the_gradient() -> None:
    moved = [torch.zeros(2, requires_grad=True) for _ in range(2)]
    for parameter in moved:
        parameter.grad = torch.tensor([4.0, -0.5])
    Adam(moved[:1], lr=0.1).step()
    Sgd(moved[1:], lr=0.1).step()
    assert moved[0].tolist() == pytest.approx([-0.1, 0.1], rel=1e-6)
    assert moved[1].tolist() == pytest.approx([-0.4, 0.05], rel=1e-6)


@pytest.mark.parametrize("name", ["adam", "sgd"])
def test_many_steps_come_to_the_bits_of_pytorchs_own(name: str) -> None:
    ours, theirs = parameters(), parameters()
    if name == "adam":
        both: tuple[tuple[list[Tensor], Adam | Sgd | torch.optim.Optimizer], ...] = (
            (ours, Adam(ours, lr=3e-3, eps=1e-4)),
            (theirs, torch.optim.Adam(theirs, lr=3e-3, eps=1e-4, fused=True)),
        )
    else:
        both = (ours, Sgd(ours, lr=3e-3)), (theirs, torch.optim.SGD(theirs, lr=3e-3, fused=True))
    for step in range(50):
        for moved, optimizer in both:
            generator = torch.Generator().manual_seed(step)
            for parameter in moved:
                parameter.grad = torch.randn(parameter.shape, generator=generator)
            optimizer.step()
    assert all(torch.equal(one, other) for one, other in zip(ours, theirs, strict=True))


def test_a_parameter_without_a_gradient_stays_and_the_others_move_by_their_own() -> None:
    first, second = torch.zeros(1, requires_grad=True), torch.zeros(1, requires_grad=True)
    second.grad = torch.tensor([2.0])
    for optimizer in (Adam([first, second], lr=0.1), Sgd([first, second], lr=0.1)):
        optimizer.step()
    assert first.item() == 0
    assert second.item() == pytest.approx(-0.1 - 0.2, rel=1e-6)
