"""The scenario: everything that a run depends on, from a TOML file, checked before anything starts."""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from pydantic import Field, PrivateAttr, field_validator, model_validator

from jouleswarm.common.doors import Kind, digest, file_of, open_door
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.arms import META_METHODS, METHODS, SERVED_METHODS, Arm, Method, arm_name
from jouleswarm.common.scenario.sections import (
    Bus,
    Camera,
    Energy,
    Federation,
    Learning,
    Meta,
    Network,
    Section,
    Task,
    World,
)
from jouleswarm.environments.landmarks.maps import TaskMap, parse_map

CHANGES_NOTHING: dict[str, bool | set[str]] = {
    "name": True,
    "energy": True,
    "bus": True,
    "federation": {"give_up_after_s"},
}
"""Settings that may be others when a process goes on from its state: what is learned does not depend on them."""


class Scenario(Section):
    """A whole experiment. Build one with `load_scenario`."""

    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$", max_length=200)
    seed: int = Field(1, ge=0, le=2**63 - 1)
    methods: tuple[Method, ...] = ("maml", "fl")
    tasks: tuple[Task, ...] = Field(min_length=1, max_length=1000)
    world: World = World()
    camera: Camera = Camera()
    network: Network = Network()
    learning: Learning = Learning()
    federation: Federation = Federation()
    meta: Meta = Meta()
    energy: Energy = Energy()
    bus: Bus = Bus()
    _folder: Path | None = PrivateAttr(None)
    _prices_folder: Path | None = PrivateAttr(None)

    def model_post_init(self, context: Any) -> None:
        """Remember where files are that the scenario names (see `common.doors`): price lists in another folder first,
        when a run is priced again."""
        self._folder = (context or {}).get("folder")
        self._prices_folder = (context or {}).get("prices_folder")

    @field_validator("methods")
    @classmethod
    def _methods_differ(cls, methods: tuple[str, ...]) -> tuple[str, ...]:
        if not methods or len(set(methods)) != len(methods):
            raise ValueError(f"name each method once, one or more of {', '.join(METHODS)}")
        return methods

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
        if self.meta_methods and self.meta.t0 < 1:
            raise ValueError('meta.t0 is 0, expected 1 or more (or methods = ["fl"])')
        if self.meta_methods and not self.meta.training_tasks:
            raise ValueError(
                f"meta.training_tasks is empty and methods has {', '.join(self.meta_methods)}: expected one or more of "
                f"the tasks {ids}"
            )
        if self.meta_methods and not set(self.meta.training_tasks) <= set(ids):
            raise ValueError(f"meta.training_tasks {self.meta.training_tasks} are not all among the tasks {ids}")
        meta = self.meta
        if meta.support_batches % meta.inner_steps or meta.query_batches % (meta.support_batches // meta.inner_steps):
            raise ValueError(
                f"meta.inner_steps {meta.inner_steps} cuts support_batches {meta.support_batches} and query_batches "
                f"{meta.query_batches} into unequal meta-updates; expected a divisor"
            )
        for name in ("snapshots", "adapt_from"):
            rounds = getattr(self.meta, name)
            if any(round_ > self.meta.t0 for round_ in rounds):
                raise ValueError(f"meta.{name} {rounds} reach past meta.t0 = {self.meta.t0}")
        self._check_on_missing()
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
        if not any(":" in name for _, name in self.named):
            self._folder = self._prices_folder = None  # two scenarios are equal wherever they were read from
        return self

    def _check_on_missing(self) -> None:
        served = [method for method in self.methods if method in SERVED_METHODS]
        if self.federation.on_missing == "proceed" and (served or self.federation.codec == "topk"):
            raise ValueError(
                f'federation.on_missing = "proceed" with {", ".join(served) or "codec topk"}: expected methods over '
                "sidelinks and a codec whose messages are whole, for who comes back has missed some"
            )

    @property
    def folder(self) -> Path | None:
        """Where the files are that the scenario names; None where it names none."""
        return self._folder

    @property
    def named(self) -> tuple[tuple[Kind, str], ...]:
        """What comes in by doors."""
        return tuple(("prices", name) for name in self.energy.prices)

    @property
    def files(self) -> dict[str, Path]:
        """Files of the user's own that come in by doors, by the name of their module."""
        found = {name.partition(":")[0]: file_of(name, self._beside(kind, name)) for kind, name in self.named}
        return {module: path for module, path in found.items() if path is not None}

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of `files`."""
        return {module: digest(path) for module, path in sorted(self.files.items())}

    @property
    def learned_by(self) -> dict[str, str]:
        """Those of `digests` that what is learned depends on: all but price lists."""
        modules = {name.partition(":")[0] for kind, name in self.named if kind != "prices"}
        return {module: found for module, found in self.digests.items() if module in modules}

    @property
    def determines(self) -> str:
        """All that what is learned depends on, as text."""
        settings = self.model_dump_json(exclude=CHANGES_NOTHING)
        return settings + (json.dumps(digests) if (digests := self.learned_by) else "")

    def open(self, kind: Kind, name: str) -> Any:
        """What goes by a name of the scenario's (see `common.doors.open_door`), the same however its file changes."""
        if (kind, name) not in self.opened:
            self.opened[kind, name] = open_door(kind, name, self._beside(kind, name))
        return self.opened[kind, name]

    @cached_property
    def opened(self) -> dict[tuple[Kind, str], Any]:
        """What has been opened so far."""
        return {}

    def _beside(self, kind: Kind, name: str) -> Path | None:
        """The folder in which a name's file is looked for."""
        first = self._prices_folder if kind == "prices" else None
        return first if file_of(name, first) is not None else self._folder

    @property
    def meta_methods(self) -> tuple[Method, ...]:
        """Those of the methods that train a model in the data center first."""
        return tuple(method for method in self.methods if method in META_METHODS)

    @property
    def needs_datacenter(self) -> bool:
        """Whether any method has work for the data center."""
        return any(method in (*META_METHODS, *SERVED_METHODS) for method in self.methods)

    @cached_property
    def arms(self) -> tuple[Arm, ...]:
        """What robots do one after the other: each method, from each meta-model that is adapted."""
        arms: list[Arm] = []
        for method in self.methods:
            meta = method in META_METHODS
            on_the_way = sorted(set(self.meta.adapt_from) - {self.meta.t0}) if meta else []
            arms += [Arm(arm_name(method, t0), method, t0) for t0 in on_the_way]
            arms.append(Arm(method, method, self.meta.t0 if meta else 0))
        return tuple(arms)

    @cached_property
    def arm_names(self) -> tuple[str, ...]:
        """Names of the arms, as they stand in topics."""
        return tuple(arm.name for arm in self.arms)

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
        """Training task id -> ids of the robots that send its experience up; only meta methods need all tasks there."""
        tasks = [task for task in self.meta.training_tasks if task in self.clusters]
        return {task: self.cluster(task)[: self.meta.robots_per_task] for task in tasks}

    def task(self, task: int) -> Task:
        """The task with id `task`."""
        return next(each for each in self.tasks if each.id == task)

    def task_map(self, task: int) -> TaskMap:
        """The parsed map of a task."""
        return parse_map(self.task(task).map, self.world.rows, self.world.cols)
