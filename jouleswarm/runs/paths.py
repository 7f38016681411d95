"""The way that a learned model goes: one greedy episode of each task, by the weights that the run has kept."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jouleswarm.common.errors import JouleSwarmError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.saved_models import read_saved_model
from jouleswarm.common.wire.types import Weights
from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.runs.run import Run

if TYPE_CHECKING:
    from jouleswarm.environments.landmarks.cameras import Frames

LANDMARKS = "landmarks"


def learned_paths(run: Run) -> dict[tuple[str, int], tuple[Cell, ...]]:
    """(arm, task) -> cells from the entry on; without those whose weights were not kept, or cannot be read.

    Of the landmarks alone: other environments have no map.
    """
    if run.scenario.environment != LANDMARKS:
        return {}
    files = {
        (arm, task): run.path / "weights" / f"{arm}-task{task}.safetensors"
        for arm in run.scenario.arm_names
        for task in run.scenario.clusters
    }
    kept = {key: file for key, file in files.items() if file.exists()}
    if not kept:
        return {}
    from jouleswarm.environments.landmarks.cameras import new_camera

    camera, found = new_camera(run.scenario), {}
    for key, file in kept.items():
        try:
            found[key] = greedy_path(run.scenario, key[1], read_saved_model(file.read_bytes()), camera)
        except JouleSwarmError:  # of a damaged file: a drawing less, and no bill is of it
            continue
    return found


def greedy_path(scenario: Scenario, task: int, weights: Weights, camera: Frames) -> tuple[Cell, ...]:
    """Cells of one greedy episode from the entry."""
    from jouleswarm.codecs.frames import shrink
    from jouleswarm.environments.landmarks.environment import LandmarksEnv
    from jouleswarm.learning.learner import Policy
    from jouleswarm.learning.networks import build_qnetwork

    policy = Policy(build_qnetwork(scenario), weights)
    kept = scenario.spaces.observation.kept(scenario.network)
    world = LandmarksEnv(task, scenario, camera=camera)
    frame, info = world.reset(seed=0)
    cells, ended = [info["cell"]], False
    while not ended:
        action = int(policy.q_values(shrink(frame, kept)).argmax())
        frame, _, reached, cut, info = world.step(action)
        cells.append(info["cell"])
        ended = reached or cut
    return tuple(cells)
