"""Rewards, best policies, errors along the path and exploring starts, worked out by hand."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.maps import TaskMap, parse_map
from jouleswarm.environments.landmarks.settings import World
from jouleswarm.environments.landmarks.settings import task_map as map_of
from jouleswarm.environments.landmarks.tasks import (
    BACKWARD,
    FORWARD,
    LEFT,
    RIGHT,
    action_values,
    move,
    reward_table,
    rmse_m,
    start_cells,
    table_policy,
    task_table,
)

SCENARIOS = Path(__file__).parents[2] / "scenarios"
WORLD = World(rows=3, cols=3)
SMALL = parse_map(
    """
    E . .
    * # .
    * * X
    """,
    3,
    3,
)


@pytest.fixture(scope="module")
def paper() -> Scenario:
    return load_scenario(SCENARIOS / "paper.toml")


@pytest.fixture(scope="module")
def hexapod() -> Scenario:
    return load_scenario(SCENARIOS / "hexapod.toml")


def test_motions_go_to_the_next_landmark() -> None:
    assert [move((1, 1), action, 3, 3) for action in (FORWARD, BACKWARD, LEFT, RIGHT)] == [
        (2, 1),
        (0, 1),
        (1, 0),
        (1, 2),
    ]


@pytest.mark.parametrize(("cell", "action"), [((2, 1), FORWARD), ((0, 1), BACKWARD), ((1, 0), LEFT), ((1, 2), RIGHT)])
def test_a_motion_off_the_edge_stays(cell: tuple[int, int], action: int) -> None:
    assert move(cell, action, 3, 3) == cell


def test_reward_table_of_a_small_map() -> None:
    # Path of L = 4 motions: -0.5 - 3.5 (1 - i/4) = -4, -3.125, -2.25, -1.375, then the exit (as path: -0.5).
    # (0,1) is 1 off (0,0): -4 - 5.5. (0,2) is 2 off (0,0) and 2 off (2,2): the better, -0.5 - 11.
    # (1,2) is 1 off (2,2): -0.5 - 5.5.
    expected = [[-4, -9.5, -11.5], [-3.125, -80, -6], [-2.25, -1.375, 80]]
    table = reward_table(SMALL, WORLD)
    assert table.dtype == np.float32
    assert table.tolist() == expected


def test_reward_table_follows_the_scenario_numbers() -> None:
    world = World(rows=3, cols=3, exit_reward=9, path_reward=-1, path_slope=0, off_path_reward=-2, obstacle_reward=-7)
    assert reward_table(SMALL, world).tolist() == [[-1, -3, -5], [-1, -7, -3], [-1, -1, 9]]


def test_explicit_rewards_are_taken_row_by_row() -> None:
    assert reward_table(SMALL, WORLD, range(9)).tolist() == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]


def test_action_values_of_a_small_map() -> None:
    # nu = 1. From the entry: F, down the path: -3.125 - 2.25 - 1.375 + 80 = 73.25. B and L stay: -4 + 73.25.
    # R: -9.5, then back and down the path, -4 + 73.25, is 59.75 (on over the top right: -9.5 - 11.5 - 6 + 80 = 53).
    values = action_values(reward_table(SMALL, WORLD), SMALL, discount=1.0)
    np.testing.assert_allclose(values[:, 0, 0], [73.25, 69.25, 69.25, 59.75], atol=1e-6)
    assert values[:, 2, 2].tolist() == [0, 0, 0, 0]


def test_policy_of_a_small_map() -> None:
    # On the obstacle (1,1): F, then R is -1.375 + 80; R, then F is -6 + 80. From (0,1) back to the path: L is
    # -4 + 73.25; R is -11.5 - 6 + 80.
    policy = table_policy(reward_table(SMALL, WORLD), SMALL, discount=1.0)
    expected = [[FORWARD, LEFT, FORWARD], [FORWARD, FORWARD, FORWARD], [RIGHT, RIGHT]]
    assert [row.tolist() for row in policy[:2]] == expected[:2]
    assert policy[2, :2].tolist() == expected[2]


def test_ties_go_to_the_first_action() -> None:
    square = parse_map("E*\n.X", 2, 2)
    policy = table_policy(reward_table(square, World(), [-1, -1, -1, 80]), square)
    assert policy[0, 0] == FORWARD  # as good as RIGHT


def test_values_end_where_loitering_without_discount_is_best() -> None:
    square = parse_map("E*\n.X", 2, 2)
    values = action_values(np.ones((2, 2), np.float32), square, discount=1.0, max_sweeps=50)
    assert values.max() == 51  # 50 sweeps and the motion itself, each worth 1


def test_best_return_of_the_straight_task(paper: Scenario) -> None:
    # Task 3 goes straight on for 7 motions: arriving at i = 1..6 is worth -4 + 3.5 i / 7, the exit 80. nu = 0.99:
    # - 3.5 - 2.97 - 2.45025 - 1.940598 - 1.440894 - 0.950990 + 80 x 0.941480 = 62.0657
    values = action_values(task_table(paper, 3), map_of(paper, 3), 0.99)
    assert values[:, 0, 2].max() == pytest.approx(62.0657, abs=1e-4)


@pytest.mark.parametrize("task", range(1, 7))
def test_every_paper_task_can_be_learned(paper: Scenario, task: int) -> None:
    task_map, table = map_of(paper, task), task_table(paper, task)
    assert action_values(table, task_map, 0.99)[:, 0, 2].max() >= paper.federation.target_reward == 50
    walked = follow(table_policy(table, task_map), task_map)
    assert walked == task_map.path
    others = [table[r, c] for r in range(8) for c in range(5) if (r, c) != task_map.exit]
    assert max(others) < 0  # else loitering could pay


def follow(policy: np.ndarray, task_map: TaskMap) -> tuple[tuple[int, int], ...]:
    walked = [task_map.entry]
    while walked[-1] != task_map.exit and len(walked) <= 20:
        walked.append(move(walked[-1], int(policy[walked[-1]]), task_map.rows, task_map.cols))
    return tuple(walked)


HEXAPOD_IDS = [-3, -4, -4, -5, -4, -4, -2, -2, -2, -2, -80, -80, -80, -1, -3, -3, -1, -80, -80, -80]
HEXAPOD_IDS += [0, 0, 0, 0, -4, -6, -5, -4, 0, 1, 80, 1, -4, -5, -6]
SERPENTINE = [(i // 5, i % 5 if i // 5 % 2 == 0 else 4 - i % 5) for i in range(35)]


def test_hexapod_table_is_the_authors_table_in_serpentine_order(hexapod: Scenario) -> None:
    table, task_map = task_table(hexapod, 1), map_of(hexapod, 1)
    assert [table[cell] for cell in SERPENTINE] == HEXAPOD_IDS
    assert (task_map.entry, task_map.exit) == (SERPENTINE[0], SERPENTINE[30])
    assert task_map.obstacles == {cell for cell, reward in zip(SERPENTINE, HEXAPOD_IDS, strict=True) if reward == -80}


def test_hexapod_drawing_is_a_best_route(hexapod: Scenario) -> None:
    task_map, nu = map_of(hexapod, 1), hexapod.learning.discount
    assert task_map.path == tuple(SERPENTINE[i] for i in (0, 9, 8, 7, 6, 13, 16, 23, 22, 21, 20, 29, 30))
    values = action_values(task_table(hexapod, 1), task_map, nu)
    for here, there in zip(task_map.path, task_map.path[1:], strict=False):
        action = next(a for a in range(4) if move(here, a, 7, 5) == there)
        assert values[(action, *here)] == pytest.approx(values[(slice(None), *here)].max())
    # nu = 0.985: -2 (1 + 0.985 + 0.970225 + 0.955672) - 0.941337 - 0.927217 + 0.859730 + 80 x 0.846834 = 58.9161
    assert values[:, 0, 0].max() == pytest.approx(58.9161, abs=1e-3)
    assert follow(table_policy(task_table(hexapod, 1), task_map, nu), task_map)[-1] == task_map.exit


def test_hexapod_table_makes_loitering_best_at_the_papers_discount(hexapod: Scenario) -> None:
    values = action_values(task_table(hexapod, 1), map_of(hexapod, 1), 0.99)[(slice(None), *SERPENTINE[29])]
    assert values[LEFT] == pytest.approx(100, abs=1e-4)  # stay, +1 for ever: 1 / (1 - 0.99)
    assert values[FORWARD] == 80  # leave


def test_rmse_is_zero_on_the_path() -> None:
    assert rmse_m(SMALL.path, SMALL, 1.0) == 0


@pytest.mark.parametrize(
    ("walked", "mean_square"),
    [
        (((0, 0), (0, 1), (0, 2), (1, 2), (2, 2)), (0 + 2 + 8 + 2 + 0) / 5),
        (((0, 0), (1, 0)), (0 + 0 + 1 + 2 + 5) / 5),  # the walk waits at (1,0)
        (((0, 0), *SMALL.path), (0 + 1 + 1 + 1 + 1 + 0) / 6),  # one motion late; the path waits at the exit
    ],
)
def test_rmse_is_aligned_in_time(walked: tuple[tuple[int, int], ...], mean_square: float) -> None:
    assert rmse_m(walked, SMALL, 2.0) == pytest.approx(2 * mean_square**0.5)


def test_areas_of_two_robots() -> None:
    # 9 landmarks less the exit and one obstacle are 7: 3 and 4
    assert start_cells(SMALL, 0, 2) == ((0, 0), (0, 1), (0, 2))
    assert start_cells(SMALL, 1, 2) == ((1, 0), (1, 2), (2, 0), (2, 1))


@given(shares=st.integers(1, 7))
def test_areas_are_near_equal_and_cover_everything_once(shares: int) -> None:
    areas = [start_cells(SMALL, share, shares) for share in range(shares)]
    cells = [cell for area in areas for cell in area]
    assert sorted(cells) == sorted({(r, c) for r in range(3) for c in range(3)} - {(1, 1), (2, 2)})
    assert max(map(len, areas)) - min(map(len, areas)) <= 1


def test_more_robots_than_landmarks_still_start_somewhere() -> None:
    assert start_cells(SMALL, 7, 9) == ((0, 0),)


@pytest.mark.parametrize(("share", "shares"), [(2, 2), (-1, 2), (0, 0)])
def test_an_area_that_does_not_exist_is_refused(share: int, shares: int) -> None:
    with pytest.raises(ConfigurationError, match=f"area {share} of {shares}"):
        start_cells(SMALL, share, shares)
