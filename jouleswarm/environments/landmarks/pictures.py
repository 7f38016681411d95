"""Where a user's recorded pictures are, and which are missing.

FOLDER/ROW-COL/NAME.png or .jpg    what the camera saw at landmark (ROW, COL), both counted from 0
FOLDER/ROW-COL/NAME.depth.png      its distances beside it, 16 bit, millimetres
FOLDER/ROW-COL/NAME.npz            or so: an array `depth`, metres
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from jouleswarm.environments.landmarks.maps import Cell

_PICTURES = (".png", ".jpg", ".jpeg")
_DEPTH, _DEPTH_ARRAY = ".depth.png", ".npz"


def pictures(folder: Path, cell: Cell) -> list[Path]:
    """The pictures of a landmark, by name."""
    at = folder / f"{cell[0]}-{cell[1]}"
    every = sorted(at.iterdir()) if at.is_dir() else []
    return [path for path in every if path.suffix.lower() in _PICTURES and not path.name.lower().endswith(_DEPTH)]


def missing(folder: Path, rows: int, cols: int) -> Iterator[str]:
    """What a folder lacks for a grid of landmarks, in one line: those without a picture, and pictures without depth."""
    if not folder.is_dir():
        yield f"camera.frames {folder}: no such folder"
        return
    cells = [(row, col) for row in range(rows) for col in range(cols)]
    found = {cell: pictures(folder, cell) for cell in cells}
    if bare := [f"{row}-{col}" for (row, col), held in found.items() if not held]:
        yield (
            f"camera.frames {folder}: no picture of landmarks {', '.join(bare)}; expected ROW-COL/NAME.png or .jpg "
            f"for each of world.rows {rows} x world.cols {cols}"
        )
    if flat := [str(path.relative_to(folder)) for held in found.values() for path in held if depth_of(path) is None]:
        yield (
            f"camera.frames {folder}: no depth of {', '.join(flat)}; expected NAME{_DEPTH} (16 bit, mm) or "
            f"NAME{_DEPTH_ARRAY} (depth, m) beside"
        )


def depth_of(picture: Path) -> Path | None:
    """The file beside a picture that holds its distances."""
    beside = (picture.with_name(picture.stem + ending) for ending in (_DEPTH, _DEPTH_ARRAY))
    return next((path for path in beside if path.is_file()), None)
