"""What R at the target says of the path walked: every loop-free path from entry to exit is looked at."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.maps import Cell, TaskMap, parse_map
from jouleswarm.environments.landmarks.settings import task_map, world_of
from jouleswarm.environments.landmarks.tasks import (
    ACTIONS,
    action_values,
    move,
    rmse_m,
    table_policy,
    task_table,
)

SCENARIOS = Path(__file__).parents[2] / "scenarios"
TASKS = range(1, 7)
MARGIN = 5.0


class Walked(NamedTuple):
    """A path that earns at least the target."""

    path: tuple[Cell, ...]
    reward: float  # R, the discounted return
    rmse_m: float


def passing(
    table: npt.NDArray[np.float32], drawn: TaskMap, discount: float, target: float, motions: int
) -> list[Walked]:
    """All self-avoiding paths of at most `motions` from entry to exit with a discounted return of at least `target`.

    Branch and bound: a path is given up where what it has earned and the best return from here on (value iteration,
    which may go on for longer and cross the path, so never too low) stay below the target.
    """
    best = action_values(table, drawn, discount).max(axis=0)

    def onward(path: tuple[Cell, ...], earned: float, factor: float) -> Iterator[Walked]:
        here = path[-1]
        if here == drawn.exit:
            if earned >= target:
                yield Walked(path, earned, rmse_m(path, drawn, cell_m=1.0))
            return
        if len(path) > motions or earned + factor * best[here] < target - 1e-6:
            return
        for action in ACTIONS:
            there = move(here, action, drawn.rows, drawn.cols)
            if there not in path:
                yield from onward((*path, there), earned + factor * float(table[there]), factor * discount)

    return list(onward((drawn.entry,), 0.0, 1.0))


def passing_of(scenario: Scenario, task: int) -> list[Walked]:
    table, drawn = task_table(scenario, task), task_map(scenario, task)
    motions, target = world_of(scenario).max_motions, scenario.federation.target_reward
    return passing(table, drawn, scenario.learning.discount, target, motions)


@pytest.fixture(scope="module", params=["quick", "paper"])
def scenario(request: pytest.FixtureRequest) -> Scenario:
    return load_scenario(SCENARIOS / f"{request.param}.toml")


SQUARE = parse_map("E*\n.X", 2, 2)


@pytest.mark.parametrize(
    ("target", "motions", "found"),
    [
        # nu = 0.5: over (0,1) -1 + 0.5 x 8 = 3 on the path; over (1,0) -3 + 4 = 1, one landmark of three sqrt(2) m off.
        (1.0, 2, [(1.0, pytest.approx((2 / 3) ** 0.5)), (3.0, 0.0)]),
        (1.1, 2, [(3.0, 0.0)]),
        (3.1, 2, []),
        (-9.0, 1, []),
    ],
)
def test_all_paths_that_pass_are_found(target: float, motions: int, found: list[tuple[float, float]]) -> None:
    table = np.array([[-5, -1], [-3, 8]], np.float32)
    walked = passing(table, SQUARE, 0.5, target, motions)
    assert sorted((each.reward, each.rmse_m) for each in walked) == found


def test_no_path_is_lost() -> None:
    # From corner to corner of a 3 x 3 grid there are 12 self-avoiding paths: 6 of 4 motions, 4 of 6 and 2 of 8.
    drawn = parse_map("E . .\n* . .\n* * X", 3, 3)
    for motions, expected in ((3, 0), (4, 6), (7, 10), (8, 12)):
        assert len(passing(np.full((3, 3), -1.0, np.float32), drawn, 1.0, -100.0, motions)) == expected


@pytest.mark.parametrize("task", TASKS)
def test_whoever_reaches_the_target_has_walked_the_trajectory(scenario: Scenario, task: int) -> None:
    # The paper: R = 50 is an RMSE of 0.5 to 1 m.
    walked = passing_of(scenario, task)
    assert max(each.rmse_m for each in walked) <= 1.0


@pytest.mark.parametrize("task", TASKS)
def test_the_path_itself_passes_with_room_to_spare(scenario: Scenario, task: int) -> None:
    best = max(passing_of(scenario, task), key=lambda each: each.reward)
    assert best.path == task_map(scenario, task).path
    assert best.reward >= scenario.federation.target_reward + MARGIN


@pytest.mark.parametrize("task", TASKS)
def test_from_everywhere_the_best_policy_leads_to_the_exit(scenario: Scenario, task: int) -> None:
    table, drawn = task_table(scenario, task), task_map(scenario, task)
    policy = table_policy(table, drawn, scenario.learning.discount)
    for start in np.ndindex(drawn.rows, drawn.cols):
        here: Cell = (start[0], start[1])
        for _ in range(drawn.rows * drawn.cols):
            here = here if here == drawn.exit else move(here, int(policy[here]), drawn.rows, drawn.cols)
        assert here == drawn.exit
