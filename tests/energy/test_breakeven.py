"""From how many tasks or returns on a stage pays, worked out by hand."""

from __future__ import annotations

import math

import pytest

from jouleswarm.energy.breakeven import Savings, gain, returns_to_pay, tasks_to_pay


def test_seen_tasks_come_first_and_the_others_save_less() -> None:
    # 3 seen tasks save 30 J of 130 J; 100 J are left for tasks that save 2 J: 50 more.
    assert tasks_to_pay(Savings(130, 10, 2, 3)) == 53
    assert gain(Savings(130, 10, 2, 3, plain_j=20), 53) == pytest.approx(1)
    assert gain(Savings(130, 10, 2, 3, plain_j=20), 200) == pytest.approx(4000 / (130 + 4000 - 30 - 394))


def test_seen_tasks_alone_may_pay() -> None:
    assert tasks_to_pay(Savings(15, 10, -1, 3)) == 1.5


def test_never_is_an_answer() -> None:
    assert tasks_to_pay(Savings(130, 10, 0, 3)) == math.inf
    assert tasks_to_pay(Savings(130, 10, -2, 3)) == math.inf
    assert returns_to_pay(Savings(130, -1, 2, 3)) == math.inf


def test_a_seen_task_that_costs_more_is_paid_for_by_the_others() -> None:
    assert tasks_to_pay(Savings(100, -5, 2, 2)) == 2 + 110 / 2


def test_returns_of_seen_tasks_pay_for_the_stage() -> None:
    assert returns_to_pay(Savings(130, 10, 2, 3)) == 13
