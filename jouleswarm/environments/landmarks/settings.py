"""What a scenario says of the landmarks: its tables `[world]` and `[camera]`, and each task's map."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Section
from jouleswarm.environments.landmarks.maps import Cell, TaskMap, parse_map

CHANNELS = ("red", "green", "blue", "depth")
ACTION_NAMES = ("forward", "backward", "left", "right")

Landmarks = Annotated[int, Field(ge=1, le=64)]
CameraPixels = Annotated[int, Field(ge=1, le=4096)]
Metres = Annotated[float, Field(ge=1e-3, le=1e4)]
RewardSetting = Annotated[float, Field(ge=-1e6, le=1e6)]  # see common.wire.messages.MAX_REWARD


class World(Section):
    """The landmark grid and how a map becomes a position-reward table."""

    rows: Landmarks = Field(8, description="of the grid; all maps have as many")
    cols: Landmarks = Field(5, description="the same")
    cell_m: Metres = Field(1.0, description="distance between landmarks, metres")
    exit_reward: RewardSetting = Field(80.0, description="at the exit, which ends the episode")
    path_reward: RewardSetting = Field(-0.5, description="reward on the path next to the exit")
    path_slope: float = Field(3.5, ge=0, le=1e6, description="how much lower the reward is at the path's beginning")
    off_path_reward: RewardSetting = Field(
        -5.5, description="added for each motion away from the nearest path landmark"
    )
    obstacle_reward: RewardSetting = Field(-80.0, description="at an obstacle, which ends nothing")
    max_motions: int = Field(20, ge=1, le=100_000, description="an episode is truncated after this many motions")


class Camera(Section):
    """The robots' two cameras: RGB and time of flight (5 m range), one frame = (height, width, 4) uint8."""

    width: CameraPixels = Field(640, description="of a frame, pixels")
    height: CameraPixels = Field(480, description="the same")
    range_m: Metres = Field(5.0, description="what is further away is as far as this for the time-of-flight camera")
    pose_jitter_m: float = Field(
        0.03, ge=0, le=1e4, description="a robot stands within this of its landmark, along each axis, metres"
    )
    heading_jitter_deg: float = Field(2.0, ge=0, lt=45, description="and looks within this of straight ahead")
    noise: float = Field(4.0, ge=0, le=255, description="standard deviation of the sensor noise, grey levels")
    draw: Literal["frame", "input"] = Field(
        "input",
        description="what robots look at when they learn and are evaluated: input, drawn at the network's input size, "
        "or frame, drawn at width x height and shrunk: slower, and the same but for rounding and noise; what goes up "
        "to the data center is width x height with both",
    )
    frames: str | None = Field(
        None,
        max_length=4096,
        description="folder of recorded pictures in place of drawn ones, FOLDER/ROW-COL/NAME.png with its depth "
        "beside; relative to the scenario file (see landmarks/pictures.py)",
    )


class Trajectory(Section):
    """A task's own fields: the path to follow, drawn as a text map (see landmarks/maps.py)."""

    map: str = Field(description="one line a row: E entry, * path, X exit, # obstacle, . floor")
    rewards: tuple[RewardSetting, ...] | None = Field(
        None, description="position-reward table, row by row, in place of the one made from the map"
    )


def world_of(scenario: Scenario) -> World:
    """The table `[world]`."""
    return scenario.own("world", World)


def camera_of(scenario: Scenario) -> Camera:
    """The table `[camera]`."""
    return scenario.own("camera", Camera)


def task_map(scenario: Scenario, task: int) -> TaskMap:
    """The parsed map of a task.

    Raises:
        ConfigurationError: it is none.
    """
    world, fields = world_of(scenario), scenario.task(task).model_extra or {}
    return parse_map(fields["map"], world.rows, world.cols)


def task_rewards(scenario: Scenario, task: int) -> tuple[float, ...] | None:
    """A task's own position-reward table, row by row; None: as its map makes it."""
    rewards: tuple[float, ...] | None = (scenario.task(task).model_extra or {})["rewards"]
    return rewards


def shared_obstacles(scenario: Scenario) -> frozenset[Cell]:
    """Obstacles of every task: only these stand in the one world that all robots see."""
    return frozenset.intersection(*(task_map(scenario, task.id).obstacles for task in scenario.tasks))
