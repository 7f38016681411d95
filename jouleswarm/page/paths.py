"""The way of a learned model through its task: one greedy episode, from the weights that a run has kept."""

from __future__ import annotations

import logging
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from jouleswarm.common.errors import JouleSwarmError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.page.maps import has_maps

if TYPE_CHECKING:
    from jouleswarm.environments.landmarks.cameras import Frames

log = logging.getLogger("jouleswarm.page")


class Paths:
    """Of all models in a run directory, each walked once, in a thread beside whoever asks."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "weights"
        self._camera: Frames | None = None
        self._walker: threading.Thread | None = None
        self._found: dict[tuple[str, int], tuple[Cell, ...]] = {}

    def look(self, scenario: Scenario) -> dict[tuple[str, int], tuple[Cell, ...]]:
        """(arm, task) -> cells, of the models known by now; none where one cannot be read."""
        if has_maps(scenario) and not (self._walker is not None and self._walker.is_alive()):
            files = {
                (arm, task): self._folder / f"{arm}-task{task}.safetensors"
                for arm in scenario.arm_names
                for task in scenario.clusters
                if (arm, task) not in self._found
            }
            new = {key: file for key, file in files.items() if file.exists()}  # the recorder has written it whole
            if new:
                self._walker = threading.Thread(target=self._walk, args=(scenario, new), name="paths", daemon=True)
                self._walker.start()
        return dict(self._found)

    def _walk(self, scenario: Scenario, files: dict[tuple[str, int], Path]) -> None:
        # Late imports: a page of another environment, or of a run that has learned nothing yet, needs no PyTorch.
        from jouleswarm.environments.landmarks.cameras import new_camera

        self._camera = self._camera or new_camera(scenario)  # drawing its views is what takes long
        for (arm, task), file in files.items():
            try:
                self._found[arm, task] = greedy_path(scenario, task, file, self._camera)
            except JouleSwarmError as error:
                log.warning("%s: no path drawn: %s", file, error)
                self._found[arm, task] = ()


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
