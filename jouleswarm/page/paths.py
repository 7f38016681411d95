"""The way of a greedy policy through its task: one episode, by the weights of who learns, or those that were kept."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from jouleswarm.common.disk.state import STATE_FILE
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.errors import JouleSwarmError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.saved_models import read_saved_model
from jouleswarm.common.wire.types import Weights
from jouleswarm.environments.landmarks.maps import Cell
from jouleswarm.page.maps import has_maps
from jouleswarm.runs.directory import STATE

if TYPE_CHECKING:
    from jouleswarm.environments.landmarks.cameras import Frames

_REST, _REST_S = 4.0, (1.0, 5.0)
"""Between two walks so many times what the last one took, from and to so many seconds: the cores are the run's."""
_WEIGHTS = "learner/online/"
"""In a robot's state; before its first round there are none."""
_MOST = 12
"""Clusters that are walked while they learn."""

log = logging.getLogger("jouleswarm.page")
Key = tuple[str, int]


class Paths:
    """Of a run directory: of each cluster that learns by its first robot's newest weights, then by what it has learned.

    Walks in a thread beside whoever asks.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._camera: Frames | None = None
        self._walker: threading.Thread | None = None
        self._next_s = 0.0
        self._learned: set[Key] = set()
        self._found: dict[Key, tuple[Cell, ...]] = {}

    def look(self, scenario: Scenario) -> dict[Key, tuple[Cell, ...]]:
        """(arm, task) -> cells, as far as known by now."""
        is_at_work = self._walker is not None and self._walker.is_alive()
        if has_maps(scenario) and not is_at_work and time.monotonic() >= self._next_s:
            states = (self._state(scenario, task) for task in scenario.clusters)
            if self._new_models(scenario) or any(path.with_name(f"{path.name}.0").exists() for path in states):
                self._walker = threading.Thread(target=self._walk, args=(scenario,), name="paths", daemon=True)
                self._walker.start()
        return dict(self._found)

    def _walk(self, scenario: Scenario) -> None:
        # Late imports: a page of another environment, or of a run that has not begun to learn, needs no PyTorch.
        import torch

        from jouleswarm.environments.landmarks.cameras import new_camera
        from jouleswarm.runs.paths import greedy_path

        torch.set_num_threads(1)
        began_s = time.monotonic()
        self._camera = self._camera or new_camera(scenario)  # drawing its views is what takes long
        for key, file in self._new_models(scenario).items():
            try:
                weights = read_saved_model(file.read_bytes())
                self._found[key] = greedy_path(scenario, key[1], weights, self._camera)
            except JouleSwarmError as error:
                log.warning("%s: no path drawn: %s", file, error)
            self._learned.add(key)
        for key, weights in self._learning(scenario):
            self._found[key] = greedy_path(scenario, key[1], weights, self._camera)
        rest_s = _REST * (time.monotonic() - began_s)
        self._next_s = time.monotonic() + min(max(rest_s, _REST_S[0]), _REST_S[1])

    def _new_models(self, scenario: Scenario) -> Mapping[Key, Path]:
        """Files that the recorder has written since."""
        wanted = [(arm, task) for arm in scenario.arm_names for task in scenario.clusters]
        files = {key: self._folder / "weights" / f"{key[0]}-task{key[1]}.safetensors" for key in wanted}
        return {key: file for key, file in files.items() if key not in self._learned and file.exists()}

    def _learning(self, scenario: Scenario) -> Iterator[tuple[Key, Weights]]:
        """Of robots that are learning now; who is just writing is left out."""
        for task in list(scenario.clusters)[:_MOST]:
            try:
                state = StateFile(self._state(scenario, task), None).load(sealed=False)
            except (JouleSwarmError, OSError) as error:
                log.debug("task %s: %s", task, error)
                continue
            if state is None or "arm" not in (place := state.values.get("place", {})):
                continue
            key = place["arm"], task
            own = {name: array for name, array in state.arrays.items() if name.startswith(_WEIGHTS)}
            weights = {name.removeprefix(_WEIGHTS): array for name, array in own.items()}
            if weights and key not in self._learned:
                yield key, weights

    def _state(self, scenario: Scenario, task: int) -> Path:
        return self._folder / STATE / client_of(scenario.cluster(task)[0]) / STATE_FILE
