"""Families of tasks with more or less in common: paths that share a stem from the entry, then part. Pure."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import combinations
from statistics import fmean

from jouleswarm.common.errors import StudyError
from jouleswarm.environments.landmarks.maps import Cell, neighbouring_cells

Path = tuple[Cell, ...]
"""Landmarks from the entry to the exit, both included."""

MAX_STEM = 6
_SHORTEST, _LONGEST = 4, 10  # motions


def draw_family(
    seed: int, stem: int, tasks: int = 6, rows: int = 8, cols: int = 5, entry: Cell = (0, 2)
) -> tuple[Path, ...]:
    """Draw paths whose first `stem` motions are the same and the next are not all.

    Each has 4 to 10 motions, its own exit, and never runs beside itself, so that `maps.parse_map` can follow its
    drawing. The same arguments give the same family.

    Args:
        seed: of the draw.
        stem: motions that all paths share, 0 to 6.
        tasks: how many paths, 2 or more.
        rows: landmarks of the grid, row by row.
        cols: landmarks of a row.
        entry: where all paths begin.

    Raises:
        StudyError: no such family exists on this grid.
    """
    if not 0 <= stem <= MAX_STEM or tasks < 2:
        raise StudyError(f"family: got a stem of {stem} motions and {tasks} tasks, expected 0 to {MAX_STEM} and 2+")
    rng = random.Random(f"family/{seed}/{stem}/{tasks}/{rows}x{cols}/{entry}")
    by_stem: dict[Path, list[Path]] = {}
    for path in _paths(rows, cols, entry):
        if len(path) > stem + 1:
            by_stem.setdefault(path[: stem + 1], []).append(path)
    stems = list(by_stem)
    rng.shuffle(stems)
    for each in stems:
        family = _family(rng, by_stem[each], stem, tasks)
        if family is not None:
            return family
    raise StudyError(
        f"family: no {tasks} paths of {_SHORTEST} to {_LONGEST} motions on {rows} x {cols} landmarks share exactly "
        f"{stem} motions from {entry}; ask for a shorter stem, fewer tasks or a larger grid"
    )


def similarity(paths: Sequence[Path]) -> float:
    """Mean over all pairs of the landmarks that both paths have over those that either has, 0 to 1.

    Raises:
        StudyError: fewer than two paths.
    """
    if len(paths) < 2:
        raise StudyError(f"similarity: got {len(paths)} path, expected two or more")
    sets = [frozenset(path) for path in paths]
    return fmean(len(a & b) / len(a | b) for a, b in combinations(sets, 2))


def drawing(path: Path, rows: int, cols: int) -> str:
    """A path as a text map (see `environments.landmarks.maps`)."""
    symbols = {**dict.fromkeys(path, "*"), path[0]: "E", path[-1]: "X"}
    return "\n".join(" ".join(symbols.get((row, col), ".") for col in range(cols)) for row in range(rows))


def _family(rng: random.Random, paths: list[Path], stem: int, tasks: int) -> tuple[Path, ...] | None:
    """Paths with exits of their own, taking at least two ways on from the stem; None where there are too few."""
    shuffled = rng.sample(paths, len(paths))
    first = shuffled[0]
    others = [path for path in shuffled if path[stem + 1] != first[stem + 1] and path[-1] != first[-1]]
    if not others:
        return None
    chosen = {first[-1]: first, others[0][-1]: others[0]}
    for path in shuffled:
        if len(chosen) == tasks:
            break
        chosen.setdefault(path[-1], path)
    family = list(chosen.values())
    rng.shuffle(family)
    return tuple(family) if len(family) == tasks else None


@lru_cache(maxsize=4)
def _paths(rows: int, cols: int, entry: Cell) -> tuple[Path, ...]:
    """All paths from the entry that never run beside themselves, of a length that a task may have."""
    return tuple(_extensions((entry,), rows, cols))


def _extensions(path: Path, rows: int, cols: int) -> Iterator[Path]:
    if len(path) > _SHORTEST:
        yield path
    if len(path) > _LONGEST:
        return
    before = set(path[:-1])
    for cell in neighbouring_cells(path[-1]):
        on_grid = 0 <= cell[0] < rows and 0 <= cell[1] < cols
        if on_grid and cell not in before and before.isdisjoint(neighbouring_cells(cell)):
            yield from _extensions((*path, cell), rows, cols)
