"""Task maps: what is read, and one clear line for each thing that can be wrong."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.environments.landmarks.maps import Cell, neighbouring_cells, parse_map


def test_a_map_gives_path_entry_exit_and_obstacles() -> None:
    task_map = parse_map("E . .\n* # .\n* * X", 3, 3)
    assert task_map.path == ((0, 0), (1, 0), (2, 0), (2, 1), (2, 2))
    assert (task_map.entry, task_map.exit) == ((0, 0), (2, 2))
    assert task_map.obstacles == {(1, 1)}
    assert (task_map.rows, task_map.cols) == (3, 3)


def test_blanks_and_margins_do_not_matter() -> None:
    assert parse_map("\n   E*\n\t. X  \n", 2, 2) == parse_map("E*\n.X", 2, 2)


def test_entry_and_exit_may_touch() -> None:
    assert parse_map("EX", 1, 2).path == ((0, 0), (0, 1))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("E*\nX.", r"map has 2 rows, expected 3 \(world.rows\)"),
        ("E.\n*\nX.", r"map row 2 has 1 landmarks, expected 2 \(world.cols\)"),
        ("E.\n*o\nX.", r"map row 2, column 2: 'o' is not one of E \* X # \."),
        ("*.\n*.\nX.", r"map has 0 entry landmarks \(E\), expected exactly 1"),
        ("E.\n*.\n*.", r"map has 0 exit landmarks \(X\), expected exactly 1"),
        ("EE\n*.\nX.", r"map has 2 entry landmarks \(E\), expected exactly 1"),
        ("E.\n..\nX.", r"map path: from row 1, column 1 there are 0 ways on, expected exactly 1"),
        ("E*\n**\nX.", r"map path: from row 1, column 1 there are 2 ways on, expected exactly 1"),
        ("EX\n..\n.*", r"map path: the \* at row 3, column 2 does not lie between entry and exit"),
        ("", r"map has 0 rows, expected 3"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(text: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message) as caught:
        parse_map(text, 3, 2)
    assert "\n" not in str(caught.value)


@given(turns=st.lists(st.booleans(), min_size=1, max_size=8))
def test_any_staircase_is_followed_from_entry_to_exit(turns: list[bool]) -> None:
    path: list[Cell] = [(0, 0)]
    for down in turns:
        r, c = path[-1]
        path.append((r + 1, c) if down else (r, c + 1))
    grid = [["."] * 9 for _ in range(9)]
    for r, c in path:
        grid[r][c] = "*"
    grid[0][0] = "E"
    grid[path[-1][0]][path[-1][1]] = "X"
    assert parse_map("\n".join(map("".join, grid)), 9, 9).path == tuple(path)


def test_neighbours_come_in_the_order_of_the_actions() -> None:
    assert neighbouring_cells((5, 2)) == ((6, 2), (4, 2), (5, 1), (5, 3))  # F, B, L, R
