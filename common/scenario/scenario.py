"""The scenario: everything that a run depends on, from a TOML file, checked before anything starts."""

from __future__ import annotations

import json
import reprlib
import tomllib
from collections.abc import Sequence
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.arms import META_METHODS, METHODS, SERVED_METHODS, Arm, Method, arm_name
from jouleswarm.common.scenario.documents import parse_json, parse_toml
from jouleswarm.common.scenario.fitting import misfits
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

SCENARIOS = Path(str(files("jouleswarm"))) / "scenarios"
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
        if misfit := next(misfits(self), None):
            raise ValueError(misfit)
        return self

    def _check_on_missing(self) -> None:
        served = [method for method in self.methods if method in SERVED_METHODS]
        if self.federation.on_missing == "proceed" and (served or self.federation.codec == "topk"):
            raise ValueError(
                f'federation.on_missing = "proceed" with {", ".join(served) or "codec topk"}: expected methods over '
                "sidelinks and a codec whose messages are whole, for who comes back has missed some"
            )

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

    A plain name is one that comes with the package: `quick`. A run's manifest.json is a scenario file too: the run's
    own, resolved.

    Raises:
        ConfigurationError: one line saying what is wrong, where, and what was expected.
    """
    path = scenario_path(path)
    try:
        text = path.read_text(encoding="utf-8")
        data = parse_json(text)["scenario"] if path.suffix == ".json" else parse_toml(text)
    except OSError as error:
        raise ConfigurationError(f"scenario {path}: cannot be read ({error.strerror})") from error
    except (KeyError, TypeError) as error:
        raise ConfigurationError(f"scenario {path}: not a run's manifest: {error}") from error
    except ValueError as error:
        expected = "a run's manifest" if path.suffix == ".json" else "valid TOML"
        raise ConfigurationError(f"scenario {path}: not {expected}: {error}") from error
    if not isinstance(data, dict):
        raise ConfigurationError(f"scenario {path}: not a run's manifest: its scenario is {_short(data)}")
    for override in overrides:
        _apply(data, override)
    return scenario_from(data, str(path))


def scenario_path(path: str | Path) -> Path:
    """A scenario's file: of a plain name, such as `quick`, the one that comes with the package.

    Raises:
        ConfigurationError: neither a file nor such a name.
    """
    path = Path(path)
    if path.suffix or len(path.parts) != 1 or path.is_file():
        return path
    if path.name not in (known := sorted(each.stem for each in SCENARIOS.glob("*.toml"))):
        raise ConfigurationError(f"scenario {path}: no file here, expected one or a name: {', '.join(known)}")
    return SCENARIOS / f"{path.name}.toml"


def with_overrides(scenario: Scenario, overrides: Sequence[str], where: str) -> Scenario:
    """A scenario with `section.key=value` overrides; `where` names its origin in errors.

    Raises:
        ConfigurationError: as `load_scenario`.
    """
    data = scenario.model_dump(mode="json")
    for override in overrides:
        _apply(data, override)
    return scenario_from(data, where)


def scenario_from(data: dict[str, Any], where: str) -> Scenario:
    """Validate a scenario given as plain data; `where` names its origin in errors."""
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise ConfigurationError(f"scenario {where}: {_one_line(error)}") from error


def _apply(data: dict[str, Any], override: str) -> None:
    key, equals, text = override.partition("=")
    shown = repr(override) if len(override) <= 80 else repr(override[:77]) + "..."
    if not equals or not key:
        raise ConfigurationError(f"override {shown}: expected section.key=value, for example meta.t0=42")
    *sections, last = key.strip().split(".")
    for section in sections:
        data = data.setdefault(section, {})
        if not isinstance(data, dict):
            raise ConfigurationError(f"override {shown}: {section!r} is not a section")
    try:
        data[last] = parse_toml(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        data[last] = text
    except ValueError as error:
        raise ConfigurationError(f"override {shown}: {error}") from error


def _one_line(error: ValidationError) -> str:
    parts = []
    for item in error.errors(include_url=False):
        where = ".".join(str(level) for level in item["loc"])
        got = "" if item["type"] in ("value_error", "missing", "extra_forbidden") else f", got {_short(item['input'])}"
        parts.append(f"{where}: {item['msg'].removeprefix('Value error, ')}{got}".removeprefix(": "))
    return "; ".join(parts)


def _short(value: object) -> str:
    try:
        text = json.dumps(value, default=str)
    except RecursionError:
        text = reprlib.repr(value)
    return text if len(text) < 60 else text[:57] + "..."
