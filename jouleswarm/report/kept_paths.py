"""The learned paths of a run, walked once and kept beside its figures: drawing the views on the way takes seconds."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ValidationError

from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.runs.paths import learned_paths
from jouleswarm.runs.run import Run

FILE = Path("figures") / "paths.json"


class _Walk(BaseModel):
    arm: str
    task: int
    cells: list[Cell]


class _Kept(BaseModel):
    models: list[tuple[str, int]]
    """Names of the files with weights, and their times."""
    walks: list[_Walk]


def kept_paths(run: Run) -> dict[tuple[str, int], tuple[Cell, ...]]:
    """`learned_paths` of a run; walked again where its weights are others than those that the kept ones are of."""
    models = [(file.name, file.stat().st_mtime_ns) for file in sorted((run.path / "weights").glob("*.safetensors"))]
    if not models:
        return {}
    path = run.path / FILE
    try:
        kept = _Kept.model_validate_json(path.read_bytes())
    except (OSError, ValidationError):
        kept = None
    if kept is None or kept.models != models:
        walks = [_Walk(arm=arm, task=task, cells=list(cells)) for (arm, task), cells in learned_paths(run).items()]
        kept = _Kept(models=models, walks=walks)
        path.parent.mkdir(exist_ok=True)
        path.write_text(kept.model_dump_json(), encoding="utf-8")
    return {(walk.arm, walk.task): tuple(walk.cells) for walk in kept.walks}
