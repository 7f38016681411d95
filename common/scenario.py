"""The scenario: everything that a run depends on, from a TOML file, checked before anything starts."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from common.errors import ConfigurationError
from common.maps import TaskMap, parse_map

Positive = Annotated[int, Field(ge=1)]
Fraction = Annotated[float, Field(ge=0, le=1)]
PositiveFloat = Annotated[float, Field(gt=0)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class World(_Part):
    """The landmark grid and how a map becomes a position-reward table."""

    rows: Positive = 8
    cols: Positive = 5
    cell_m: PositiveFloat = Field(1.0, description="distance between landmarks, metres")
    exit_reward: float = 80.0
    path_reward: float = Field(-0.5, description="reward on the path next to the exit")
    path_slope: float = Field(2.5, ge=0, description="how much lower the reward is at the path's beginning")
    off_path_reward: float = Field(-1.5, description="added for each motion away from the nearest path landmark")
    obstacle_reward: float = -80.0
    max_motions: Positive = Field(20, description="an episode is truncated after this many motions")


class Task(_Part):
    """One trajectory to follow, drawn as a text map (see common/maps.py)."""

    id: Positive
    map: str
    rewards: tuple[float, ...] | None = Field(
        None, description="position-reward table, row by row, in place of the one made from the map"
    )
    robots: int | None = Field(None, ge=1, description="cluster size; default federation.robots_per_cluster")


class Camera(_Part):
    """The robots' two cameras: RGB and time of flight (5 m range), one frame = (height, width, 4) uint8."""

    width: Positive = 640
    height: Positive = 480
    range_m: PositiveFloat = 5.0
    pose_jitter_m: float = Field(0.03, ge=0)
    heading_jitter_deg: float = Field(2.0, ge=0, lt=45)
    noise: float = Field(4.0, ge=0, description="standard deviation of the sensor noise, grey levels")


class Network(_Part):
    """The Q-network of Mnih et al. (2015): convolutions, one or more dense layers, one output an action."""

    width: Positive = 96
    height: Positive = 72
    conv: tuple[tuple[Positive, Positive, Positive], ...] = Field(
        ((32, 8, 4), (64, 4, 2), (64, 3, 1)), description="(channels, kernel, stride) of each layer"
    )
    dense: tuple[Positive, ...] = (512,)


class Learning(_Part):
    """Deep Q-learning, eq. (7), on a robot."""

    discount: Fraction = Field(0.99, description="nu")
    double: bool = Field(True, description="double learning: argmax by the online network")
    optimizer: Literal["adam", "sgd"] = "adam"
    lr: PositiveFloat = 1e-3
    grad_clip: PositiveFloat = 1.0
    batch_size: Positive = 32
    batches_per_round: Positive = Field(20, description="B_i")
    motions_per_round: Positive = Field(20, description="|E_ik|, new transitions a round")
    epsilon: Fraction = 0.1
    replay_size: Positive = 2000
    target_polyak: float = Field(0.1, gt=0, le=1, description="target += this * (online - target) ...")
    target_every: Positive = Field(1, description="... every so many gradient steps")
    starts: Literal["area", "anywhere", "entry"] = Field(
        "area", description="where learning episodes start: the robot's own share of the landmarks, any, the entry"
    )


class Federation(_Part):
    """Decentralized federated averaging inside a cluster, eq. (6)."""

    robots_per_cluster: Positive = 2
    topology: Literal["full", "ring", "random"] = "full"
    degree: Positive = Field(2, description="neighbours of each robot under the random topology")
    step: float | None = Field(None, gt=0, le=1, description="consensus step; default 1/(N+1); 1 = literal eq. (6)")
    max_rounds: Positive = 200
    target_reward: float = 50.0
    reward_window: Positive = Field(5, description="R is the mean over this many rounds")


class Meta(_Part):
    """MAML in the data center, eqs. (3)-(5)."""

    t0: int = Field(42, ge=0, description="MAML rounds before the meta-model goes down")
    snapshots: tuple[Positive, ...] = Field((), description="rounds whose meta-model is kept as well")
    training_tasks: tuple[Positive, ...] = Field((1, 2, 6), description="the Q training tasks")
    robots_per_task: Positive = Field(1, description="robots of each training cluster that send experience")
    order: Literal["exact", "first"] = Field("first", description="gradient through gradient, or first-order")
    support_batches: Positive = Field(10, description="B^(a): inner SGD steps, one batch each")
    query_batches: Positive = Field(10, description="B^(b): batches of the meta-update")
    support_newest: Positive = Field(40, description="support batches are drawn from so many newest motions")
    batch_size: Positive = 32
    inner_lr: PositiveFloat = Field(1.0, description="mu; gradients are clipped to learning.grad_clip before")
    meta_lr: PositiveFloat = Field(5e-4, description="eta, of Adam")
    target_polyak: float = Field(0.3, gt=0, le=1, description="per-task target network tracking, each round")
    epsilon: Fraction = Field(0.3, description="of the policy that collects: table-greedy with random motions")
    replay_size: Positive = 1000


class Energy(_Part):
    """Constants of the energy model (Table I). kb = 1000 bit."""

    p0_w: PositiveFloat = Field(590.0, description="P_0, data center power")
    t0_batch_s: PositiveFloat = Field(0.020, description="T_0, data center time of one batch gradient")
    pk_w: PositiveFloat = Field(5.1, description="P_k, robot power")
    tk_batch_s: PositiveFloat = Field(0.400, description="T_k, robot time of one batch gradient")
    pue: float = Field(1.67, ge=1, description="gamma")
    beta: float = Field(1.0, ge=1, description="cost of a meta-gradient over a first-order one")
    ul_bit_per_j: PositiveFloat = 200e3
    sl_bit_per_j: PositiveFloat = 500e3
    dl_bit_per_j: PositiveFloat | None = Field(None, description="default: as uplink (the paper gives none)")
    sidelink: Literal["direct", "via_base_station"] = "direct"


class Bus(_Part):
    """How messages travel."""

    qos: Literal[0, 1] = Field(1, description="of experience, weights and meta-model; control is always 1")
    keepalive_s: int = Field(60, ge=60)
    resend_after_s: PositiveFloat = Field(5.0, description="ask again for what has not come after this long")
    connect_timeout_s: PositiveFloat = Field(30.0, description="give up on a broker that does not answer")


class Scenario(_Part):
    """A whole experiment. Build one with `load_scenario`."""

    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    seed: int = Field(1, ge=0)
    arms: tuple[Literal["maml", "no_maml"], ...] = ("maml", "no_maml")
    tasks: tuple[Task, ...] = Field(min_length=1)
    world: World = World()
    camera: Camera = Camera()
    network: Network = Network()
    learning: Learning = Learning()
    federation: Federation = Federation()
    meta: Meta = Meta()
    energy: Energy = Energy()
    bus: Bus = Bus()

    @field_validator("arms")
    @classmethod
    def _arms_differ(cls, arms: tuple[str, ...]) -> tuple[str, ...]:
        if not arms or len(set(arms)) != len(arms):
            raise ValueError("name each arm once: maml, no_maml")
        return arms

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        ids = [task.id for task in self.tasks]
        if len(set(ids)) != len(ids):
            raise ValueError(f"tasks have ids {ids}, expected each id once")
        for task in self.tasks:
            try:
                task_map = parse_map(task.map, self.world.rows, self.world.cols)
            except ConfigurationError as error:
                raise ValueError(f"task {task.id}: {error}") from error
            landmarks = task_map.rows * task_map.cols
            if task.rewards is not None and len(task.rewards) != landmarks:
                raise ValueError(f"task {task.id}: {len(task.rewards)} rewards, expected {landmarks}")
        if "maml" in self.arms and self.meta.t0 < 1:
            raise ValueError('meta.t0 is 0, expected 1 or more (or arms = ["no_maml"])')
        if "maml" in self.arms and not set(self.meta.training_tasks) <= set(ids):
            raise ValueError(f"meta.training_tasks {self.meta.training_tasks} are not all among the tasks {ids}")
        if any(round_ > self.meta.t0 for round_ in self.meta.snapshots):
            raise ValueError(f"meta.snapshots {self.meta.snapshots} reach past meta.t0 = {self.meta.t0}")
        for task_id in ids:
            size = len(self.cluster(task_id))
            if (
                self.federation.topology == "random"
                and size > 1
                and (self.federation.degree >= size or self.federation.degree * size % 2)
            ):
                raise ValueError(
                    f"task {task_id}: no {self.federation.degree}-regular graph of {size} robots exists; "
                    "federation.degree must be below the cluster size and degree x size even"
                )
            if task_id in self.meta.training_tasks and self.meta.robots_per_task > size:
                raise ValueError(f"meta.robots_per_task is {self.meta.robots_per_task}, task {task_id} has {size}")
        return self

    @cached_property
    def clusters(self) -> dict[int, tuple[int, ...]]:
        """Task id -> ids of its robots; robots are numbered from 1 in the order of the tasks."""
        clusters, next_id = {}, 1
        for task in self.tasks:
            size = task.robots or self.federation.robots_per_cluster
            clusters[task.id] = tuple(range(next_id, next_id + size))
            next_id += size
        return clusters

    def cluster(self, task: int) -> tuple[int, ...]:
        """Ids of the robots that learn `task`."""
        return self.clusters[task]

    def task_of(self, agent: int) -> int:
        """The task that robot `agent` learns.

        Raises:
            ConfigurationError: no such robot.
        """
        for task, agents in self.clusters.items():
            if agent in agents:
                return task
        raise ConfigurationError(f"robot {agent} is not in the scenario, expected one of {self.agents}")

    @property
    def agents(self) -> tuple[int, ...]:
        """Ids of all robots."""
        return tuple(agent for cluster in self.clusters.values() for agent in cluster)

    @property
    def training_agents(self) -> dict[int, tuple[int, ...]]:
        """Training task id -> ids of the robots that send its experience up."""
        return {task: self.cluster(task)[: self.meta.robots_per_task] for task in self.meta.training_tasks}

    def task(self, task: int) -> Task:
        """The task with id `task`."""
        return next(each for each in self.tasks if each.id == task)

    def task_map(self, task: int) -> TaskMap:
        """The parsed map of a task."""
        return parse_map(self.task(task).map, self.world.rows, self.world.cols)


def load_scenario(path: str | Path, overrides: Sequence[str] = ()) -> Scenario:
    """Read a scenario file and apply `section.key=value` overrides (values are TOML, or plain text).

    Raises:
        ConfigurationError: one line saying what is wrong, where, and what was expected.
    """
    path = Path(path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"scenario {path}: cannot be read ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"scenario {path}: not valid TOML: {error}") from error
    for override in overrides:
        _apply(data, override)
    return scenario_from(data, str(path))


def scenario_from(data: dict[str, Any], where: str) -> Scenario:
    """Validate a scenario given as plain data; `where` names its origin in errors."""
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise ConfigurationError(f"scenario {where}: {_one_line(error)}") from error


def _apply(data: dict[str, Any], override: str) -> None:
    key, equals, text = override.partition("=")
    if not equals or not key:
        raise ConfigurationError(f"override {override!r}: expected section.key=value, for example meta.t0=42")
    *sections, last = key.strip().split(".")
    for section in sections:
        data = data.setdefault(section, {})
        if not isinstance(data, dict):
            raise ConfigurationError(f"override {override!r}: {section!r} is not a section")
    try:
        data[last] = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        data[last] = text


def _one_line(error: ValidationError) -> str:
    parts = []
    for item in error.errors(include_url=False):
        where = ".".join(str(level) for level in item["loc"])
        got = "" if item["type"] in ("value_error", "missing", "extra_forbidden") else f", got {_short(item['input'])}"
        parts.append(f"{where}: {item['msg'].removeprefix('Value error, ')}{got}".removeprefix(": "))
    return "; ".join(parts)


def _short(value: object) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) < 60 else text[:57] + "..."
