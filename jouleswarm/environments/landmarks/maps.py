"""Task maps: text drawings of a trajectory on the landmark grid.

A map has one character a landmark, rows from the entry side down, blanks ignored::

    . . E . .      E entry     X exit
    . . * . .      * path      # obstacle
    . . X . .      . free floor
"""

from __future__ import annotations

from dataclasses import dataclass

from jouleswarm.common.errors import ConfigurationError

Cell = tuple[int, int]  # (row, column)

SYMBOLS = "E*X#."


@dataclass(frozen=True)
class TaskMap:
    """A parsed map. `path` runs from the entry to the exit, both included."""

    rows: int
    cols: int
    path: tuple[Cell, ...]
    obstacles: frozenset[Cell]

    @property
    def entry(self) -> Cell:
        return self.path[0]

    @property
    def exit(self) -> Cell:
        return self.path[-1]


def parse_map(text: str, rows: int, cols: int) -> TaskMap:
    """Read a text map of `rows` x `cols` landmarks.

    Raises:
        ConfigurationError: the map's size, symbols or path are wrong; the message says where.
    """
    grid = ["".join(line.split()) for line in text.strip().splitlines()]
    if len(grid) != rows:
        raise ConfigurationError(f"map has {len(grid)} rows, expected {rows} (world.rows)")
    cells: dict[str, list[Cell]] = {symbol: [] for symbol in SYMBOLS}
    for r, line in enumerate(grid):
        if len(line) != cols:
            raise ConfigurationError(f"map row {r + 1} has {len(line)} landmarks, expected {cols} (world.cols)")
        for c, symbol in enumerate(line):
            if symbol not in cells:
                raise ConfigurationError(
                    f"map row {r + 1}, column {c + 1}: {symbol!r} is not one of {' '.join(SYMBOLS)}"
                )
            cells[symbol].append((r, c))
    for symbol, name in (("E", "entry"), ("X", "exit")):
        if len(cells[symbol]) != 1:
            raise ConfigurationError(f"map has {len(cells[symbol])} {name} landmarks ({symbol}), expected exactly 1")
    path = _follow(cells["E"][0], cells["X"][0], set(cells["*"]))
    return TaskMap(rows, cols, path, frozenset(cells["#"]))


def neighbouring_cells(cell: Cell) -> tuple[Cell, Cell, Cell, Cell]:
    """The four landmarks one motion away (some may lie off the grid)."""
    r, c = cell
    return (r + 1, c), (r - 1, c), (r, c - 1), (r, c + 1)


def _follow(entry: Cell, exit_: Cell, stars: set[Cell]) -> tuple[Cell, ...]:
    """The one way from entry over every path landmark to the exit.

    A path that touches itself could be walked in two orders, so it is refused.
    """
    path, here, left = [entry], entry, stars | {exit_}
    while here != exit_:
        onward = [cell for cell in neighbouring_cells(here) if cell in left]
        if len(onward) != 1:
            raise ConfigurationError(
                f"map path: from row {here[0] + 1}, column {here[1] + 1} there are {len(onward)} ways on, "
                "expected exactly 1 (draw an unbroken line of * from E to X that never runs beside itself)"
            )
        here = onward[0]
        left.discard(here)
        path.append(here)
    if left:
        r, c = min(left)
        raise ConfigurationError(f"map path: the * at row {r + 1}, column {c + 1} does not lie between entry and exit")
    return tuple(path)
