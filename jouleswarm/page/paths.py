"""The way of a learned model through its task: one greedy episode, from the weights that a run has kept."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from jouleswarm.common.errors import JouleSwarmError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.page.maps import has_maps

if TYPE_CHECKING:
    from jouleswarm.environments.landmarks.environment import Frames

log = logging.getLogger("jouleswarm.page")


class Paths:
    """Of all models in a run directory, each walked once. A file is there when it has been written whole."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "weights"
        self._camera: Frames | None = None
        self.found: dict[tuple[str, int], tuple[Cell, ...]] = {}
        """(arm, task) -> cells; none where a model cannot be read."""

    def look(self, scenario: Scenario, most: int = 2) -> bool:
        """Walk up to `most` models that have come since; whether there were any."""
        if not has_maps(scenario):
            return False
        wanted = [(arm, task) for arm in scenario.arm_names for task in scenario.clusters]
        files = {key: self._folder / f"{key[0]}-task{key[1]}.safetensors" for key in wanted if key not in self.found}
        new = [(key, file) for key, file in files.items() if file.exists()][:most]
        for (arm, task), file in new:
            try:
                self.found[arm, task] = self._walk(scenario, task, file)
            except JouleSwarmError as error:
                log.warning("%s: no path drawn: %s", file, error)
                self.found[arm, task] = ()
        return bool(new)

    def _walk(self, scenario: Scenario, task: int, file: Path) -> tuple[Cell, ...]:
        # Late imports: a page of another environment, or of a run that has learned nothing yet, needs no PyTorch.
        from jouleswarm.environments.landmarks.environment import new_camera

        self._camera = self._camera or new_camera(scenario)  # drawing its views is what takes long
        return greedy_path(scenario, task, file, self._camera)


def greedy_path(scenario: Scenario, task: int, file: Path, camera: Frames) -> tuple[Cell, ...]:
    """Cells of one greedy episode from the entry.

    Raises:
        PayloadError: the file is no model.
    """
    import torch

    from jouleswarm.codecs.frames import shrink
    from jouleswarm.common.wire.saved_models import read_saved_model
    from jouleswarm.environments.landmarks.environment import LandmarksEnv
    from jouleswarm.learning.learner import Policy
    from jouleswarm.learning.networks import build_qnetwork

    torch.set_num_threads(1)
    policy = Policy(build_qnetwork(scenario), read_saved_model(file.read_bytes()))
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
