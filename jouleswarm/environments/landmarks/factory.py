"""The landmarks behind the environment door: what a scenario has that names no environment."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import Observation, Spaces
from jouleswarm.common.wire.messages import MAX_REWARD
from jouleswarm.environments.landmarks.pictures import missing
from jouleswarm.environments.landmarks.settings import (
    ACTION_NAMES,
    CHANNELS,
    Camera,
    Trajectory,
    World,
    camera_of,
    task_map,
    task_rewards,
    world_of,
)

if TYPE_CHECKING:
    import gymnasium

MAX_KEPT_BYTES = 64 * 2**30
"""Of the views that a camera keeps."""


class Factory:
    """What `environment = "landmarks"` stands for (see `common.scenario.environments`)."""

    sections = {"world": World, "camera": Camera}  # noqa: RUF012
    task = Trajectory
    defaults = {  # noqa: RUF012 -- max_motions ends episodes, up to 100_000
        "network": {"width": 96, "height": 72},
        "learning": {"max_episode_steps": 100_000},
    }

    earlier = {"camera": {"draw": "frame"}}  # noqa: RUF012

    def of_task(self, scenario: Scenario, task: int) -> gymnasium.Env[Any, Any]:
        """The environment of one task."""
        # A late import: settings are read by processes that never open an environment.
        from jouleswarm.environments.landmarks.cameras import camera_in_use
        from jouleswarm.environments.landmarks.environment import LandmarksEnv

        return LandmarksEnv(task=task, scenario=scenario, camera=camera_in_use(scenario))

    def share(self, scenario: Scenario) -> object:
        """Cameras with every landmark drawn, as robots look at them and as they send them up."""
        from jouleswarm.environments.landmarks.cameras import drawn_cameras

        return drawn_cameras(scenario)

    def spaces(self, scenario: Scenario) -> Spaces:
        """A frame, and the four motions."""
        camera = camera_of(scenario)
        frame = Observation(shape=(camera.height, camera.width, len(CHANNELS)), dtype="uint8")
        return Spaces(observation=frame, actions=ACTION_NAMES, channels=CHANNELS)

    def check(self, scenario: Scenario) -> Iterator[str]:
        """What does not fit together, a line each."""
        for task in scenario.tasks:
            yield from _map_misfits(scenario, task.id)
        yield from _motions_misfits(scenario)
        yield from _camera_misfits(scenario)

    def resolve(self, data: dict[str, Any], folder: Path | None) -> dict[str, Any]:
        """The folder of recorded frames as a path that holds from anywhere."""
        camera = data.get("camera")
        frames = camera.get("frames") if isinstance(camera, Mapping) else None
        if not isinstance(frames, str) or folder is None:
            return data
        return {**data, "camera": {**data["camera"], "frames": str((folder / frames).resolve())}}

    def digest(self, scenario: Scenario) -> str:
        """SHA-256 of the recorded frames."""
        frames = camera_of(scenario).frames
        if frames is None:
            return ""
        found = hashlib.sha256()
        for path in sorted(path for path in Path(frames).rglob("*") if path.is_file()):
            found.update(f"{path.relative_to(frames)} {path.stat().st_size} ".encode() + path.read_bytes())
        return found.hexdigest()


def _map_misfits(scenario: Scenario, task: int) -> Iterator[str]:
    world, own = world_of(scenario), task_rewards(scenario, task)
    try:
        parsed = task_map(scenario, task)
    except ConfigurationError as error:
        yield f"task {task}: {error}"
        return
    landmarks = parsed.rows * parsed.cols
    if own is not None and len(own) != landmarks:
        yield f"task {task}: {len(own)} rewards, expected {landmarks}"
        return
    off_path = abs(world.off_path_reward) * (parsed.rows + parsed.cols)
    on_path = abs(world.path_reward) + world.path_slope
    made = (abs(world.exit_reward), abs(world.obstacle_reward), on_path + off_path)
    largest = max(map(abs, own), default=0.0) if own is not None else max(made)
    if largest * world.max_motions > MAX_REWARD:  # no message holds a return beyond it
        yield (
            f"world.max_motions {world.max_motions} at rewards of up to {largest:g} (task {task}) add up to "
            f"{largest * world.max_motions:g}, expected {MAX_REWARD:g} at most"
        )


def _motions_misfits(scenario: Scenario) -> Iterator[str]:
    """The data center learns from a motion once the next one of its episode has come (see datacenter/experience.py)."""
    drawing = scenario.experience_methods
    if drawing and world_of(scenario).max_motions < 2:
        yield (
            f"world.max_motions is 1 and methods has {', '.join(drawing)}: the data center would have rounds "
            "without a motion and the one after it to learn from; expected 2 or more"
        )


def _camera_misfits(scenario: Scenario) -> Iterator[str]:
    world, camera = world_of(scenario), camera_of(scenario)
    views = math.prod((3, world.rows, world.cols, camera.width * camera.height + 1, 4))  # see landmarks/camera.py
    if views > MAX_KEPT_BYTES:
        yield (
            f"camera.width x camera.height x world.rows x world.cols come to {views / 2**30:.0f} GiB for one process, "
            f"expected {MAX_KEPT_BYTES >> 30} GiB at most"
        )
    if camera.pose_jitter_m > world.cell_m / 2:
        yield (
            f"camera.pose_jitter_m {camera.pose_jitter_m:g} is more than half of world.cell_m "
            f"{world.cell_m:g}: robots would see from another landmark than they stand at"
        )
    if camera.frames is not None:
        yield from missing(Path(camera.frames), world.rows, world.cols)


landmarks = Factory()
