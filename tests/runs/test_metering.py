"""Power held against a run's times, worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.runs.metering import Power, Read, RowTime, power_of, read, spans_of
from jouleswarm.runs.power_log import Log


def watts(*samples: tuple[float, float]) -> Power:
    return power_of(Log([at for at, _ in samples], [value for _, value in samples], is_counter=False))


def row(round_: int, seconds: float, **other: Any) -> RoundRow:
    held = {"phase": "fl", "arm": "fl", "task": 1, "agent": 1, "round": round_, "seconds": seconds}
    return RoundRow.model_validate(held | other)


def time(row: RoundRow, time_s: float) -> RowTime:
    return RowTime(time_s=time_s, **row.model_dump(include={"phase", "arm", "task", "agent", "round"}))


def test_watts_are_integrated_by_the_trapezoid_from_edge_to_edge() -> None:
    power = watts((0, 0.0), (10, 10.0), (20, 10.0))  # a ramp of 1 W/s, then 10 W
    assert power.within([(0, 20)]) == (pytest.approx(50 + 100), 20)
    assert power.within([(4, 6), (15, 17)]) == (pytest.approx((4 + 6) / 2 * 2 + 20), 4)
    assert power.within([(-5, 5), (18, 40)]) == (pytest.approx(12.5 + 20), 5 + 2)  # only what the log knows of
    assert power.within([]) == (0, 0)


def test_a_counter_is_what_it_grew_by_and_where_it_was_set_back_nothing_is_known() -> None:
    power = power_of(Log([0, 10, 20, 30], [100.0, 150.0, 5.0, 35.0], is_counter=True))
    assert power.within([(5, 10)]) == (pytest.approx(25), 5)
    assert power.within([(0, 30)]) == (pytest.approx(50 + 30), 20)
    assert power.holes == [(10, 20)]


def test_where_the_meter_was_silent_nothing_is_made_up() -> None:
    power = watts((0, 5.0), (1, 5.0), (2, 5.0), (12, 5.0), (13, 5.0))  # a sample a second, ten seconds none
    assert power.holes == [(2, 12)]
    assert power.within([(0, 13)]) == (pytest.approx(15), 3)


def test_a_log_of_one_sample_knows_nothing() -> None:
    assert watts((3, 5.0)).within([(0, 9)]) == (0, 0)


def test_the_logs_clock_is_set_right() -> None:
    late = power_of(Log([0, 10], [5.0, 5.0], is_counter=False), shift_s=2.5)
    assert late.within([(0, 10)]) == (pytest.approx(5 * 7.5), 7.5)


@given(st.lists(st.tuples(st.floats(1, 2), st.floats(0, 1e3)), min_size=3, max_size=30), st.floats(0, 1))
def test_parts_add_up_to_the_whole(steps: list[tuple[float, float]], share: float) -> None:
    at = np.cumsum([step for step, _ in steps]).tolist()  # steps are too alike for holes
    power = power_of(Log(at, [value for _, value in steps], is_counter=False))
    cut = at[0] + share * (at[-1] - at[0])
    parts = [power.within([span]) for span in ((at[0], cut), (cut, at[-1]))]
    joules = sum((b - a) * (v + w) / 2 for a, b, v, w in zip(at, at[1:], *(_pairs(steps)), strict=False))
    assert sum(each for each, _ in parts) == pytest.approx(joules)
    assert sum(seconds for _, seconds in parts) == pytest.approx(at[-1] - at[0])


def _pairs(steps: list[tuple[float, float]]) -> tuple[list[float], list[float]]:
    values = [value for _, value in steps]
    return values[:-1], values[1:]


def test_a_round_ended_when_its_row_came_but_before_the_next_one_began() -> None:
    rows = [row(1, 6.0), row(2, 6.0), row(3, 6.0)]
    times = [time(rows[0], 106.0), time(rows[1], 118.0), time(rows[2], 118.0)]  # two came at once
    assert list(spans_of(rows, times).values()) == [(112, 118), (106, 112), (100, 106)]


def test_a_row_told_again_keeps_its_first_time_and_one_without_has_none() -> None:
    rows = [row(1, 6.0), row(2, 6.0)]
    assert list(spans_of(rows, [time(rows[0], 106.0), time(rows[0], 500.0)]).values()) == [(100, 106)]


def test_an_arm_has_its_part_of_the_stage_that_it_shares_and_meters_of_a_process_add_up() -> None:
    ml = [row(each, 10.0, phase="maml", arm="maml", agent=0) for each in (1, 2)]
    fl = [row(1, 4.0, arm="maml-t1", agent=2), row(1, 4.0, arm="maml", agent=2)]
    rows = [*ml, *fl]
    spans = spans_of(rows, [time(each, at) for each, at in zip(rows, (10, 20, 24, 28), strict=True)])
    powers = {0: [watts((0, 7.0), (30, 7.0))], 2: [watts((0, 1.0), (30, 1.0)), watts((0, 2.0), (27, 2.0))]}
    assert list(read(rows, spans, "maml-t1", powers)) == [
        Read("maml-t1", "ml", 0, 10.0, 10.0, pytest.approx(70.0)),
        Read("maml-t1", "fl", 2, 4.0, 4.0, pytest.approx(12.0)),
    ]
    assert list(read(rows, spans, "maml", powers)) == [
        Read("maml", "ml", 0, 20.0, 20.0, pytest.approx(140.0)),
        Read("maml", "fl", 2, 4.0, 3.0, pytest.approx(4 + 6)),  # the second one stopped at 27 s
    ]


def test_a_round_without_a_time_is_seconds_that_nothing_is_known_of() -> None:
    rows = [row(1, 6.0), row(2, 6.0)]
    (found,) = read(rows, spans_of(rows, [time(rows[0], 6.0)]), "fl", {1: [watts((0, 5.0), (60, 5.0))]})
    assert (found.seconds, found.known_s, found.joules) == (12, 6, pytest.approx(30))
