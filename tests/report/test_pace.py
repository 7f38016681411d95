"""How long a run may still take."""

import pytest

from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.report.pace import (
    Left,
    Mark,
    Pace,
    Span,
    arm_left_s,
    duration_text,
    left_text,
    most_left_s,
    rounds_to_target,
    stage_left_s,
)

# Rounds 0 to 10 in 20 s: 2 s a round. R from -40 to 20: 6 a round, so 5 rounds to 50.
RISING = Span(Mark(5.0, 0, -40.0), Mark(25.0, 10, 20.0))
FALLING = Span(Mark(5.0, 0, -40.0), Mark(25.0, 10, -41.0))
DONE = Span(Mark(5.0, 0, -40.0), Mark(15.0, 10, 51.0, is_over=True))


def test_a_cluster_is_done_when_r_goes_on_rising_to_its_target() -> None:
    assert rounds_to_target(RISING, 50.0, 200) == pytest.approx(5.0)
    assert rounds_to_target(RISING, 50.0, 12) == 2.0  # its rounds are over before
    assert rounds_to_target(FALLING, 50.0, 200) is None
    assert rounds_to_target(DONE, 50.0, 200) == 0.0


def test_an_arm_lasts_as_long_as_its_slowest_cluster_and_is_not_guessed_before_all_have_a_basis() -> None:
    assert arm_left_s([RISING, DONE], 2, 50.0, 200) == pytest.approx(10.0)  # 5 rounds of 2 s
    assert arm_left_s([RISING], 2, 50.0, 200) is None
    assert arm_left_s([RISING, FALLING], 2, 50.0, 200) is None
    assert arm_left_s([Span(RISING.first, Mark(7.0, 1, 20.0))], 1, 50.0, 200) is None  # one round is no pace


def test_a_stage_goes_on_at_its_own_pace() -> None:
    assert stage_left_s(Span(Mark(10.0, 1), Mark(22.0, 4)), 10) == pytest.approx(24.0)  # 6 rounds of 4 s
    assert stage_left_s(None, 10) is None


def test_at_most_all_arms_that_are_left_run_to_their_last_round() -> None:
    tasks = [{"id": task, "map": "E . \n * . \n X ."} for task in (1, 2)]
    scenario = scenario_from(
        {
            "name": "made-up", "world": {"rows": 3, "cols": 2}, "tasks": tasks, "methods": ["fl", "maml"],
            "meta": {"t0": 5, "training_tasks": [1]}, "federation": {"max_rounds": 30},
        },
        "test",
    )  # fmt: skip
    fl, maml = scenario.arms
    here = {("fl", 1): RISING, ("fl", 2): DONE}
    assert most_left_s(scenario, [fl], here) == pytest.approx(40.0)  # 20 rounds of 2 s
    assert most_left_s(scenario, [fl, maml], here) is None  # nobody knows how long a round of the stage is
    here["maml", 0] = Span(Mark(0.0, 0), Mark(12.0, 3))  # 4 s a round, 2 left; then 30 rounds at 2 s
    assert most_left_s(scenario, [fl, maml], here) == pytest.approx(40.0 + 8.0 + 60.0)
    assert most_left_s(scenario, [fl], {}) is None


@pytest.mark.parametrize(
    ("left", "text"),
    [
        (Left(None, None), "time left unknown"),
        (Left(40.0, None), "about 40 s left of this stage, then unknown"),
        (Left(None, 400.0), "at most 6.7 min left"),
        (Left(40.0, 7200.0), "about 40 s left of this stage, 2 h of all at most"),
    ],
)
def test_what_is_not_known_is_said_to_be_so(left: Left, text: str) -> None:
    assert left_text(left, "stage") == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(7.4, "7 s"), (119, "119 s"), (150, "2.5 min"), (3599, "60 min"), (172800, "2 days")]
)
def test_durations_have_two_digits(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


def test_marks_are_the_first_and_the_newest_of_each() -> None:
    pace = Pace()
    for mark in (Mark(1.0, 0, -40.0), Mark(3.0, 1, -30.0), Mark(4.0, 1, -30.0)):
        pace.note("fl", 1, mark)
    assert pace.spans == {("fl", 1): Span(Mark(1.0, 0, -40.0), Mark(3.0, 1, -30.0))}  # it came at 3 s
