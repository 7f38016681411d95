"""The scenario: everything that a run depends on, from a TOML file, checked before anything starts."""

from __future__ import annotations

import json
from functools import cached_property
from typing import Any, Self

from pydantic import field_validator, model_validator

from jouleswarm.common.doors import SHIPPED
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.arms import Arm, arms_of
from jouleswarm.common.scenario.furnished import Furnished
from jouleswarm.common.scenario.robots import OwnConstants

CHANGES_NOTHING: dict[str, Any] = {
    "name": True,
    "note": True,
    "energy": True,
    "bus": True,
    "robots": {"__all__": {*OwnConstants.model_fields, "kind", "position_m"}},
    "measure": True,
    "federation": {"give_up_after_s", "max_rounds", "target_reward"},
}
"""Settings that may be others when a process goes on from its state: what is learned does not depend on them, but for
how long."""


class Scenario(Furnished):
    """A whole experiment. Build one with `load_scenario`."""

    @field_validator("methods")
    @classmethod
    def _methods_differ(cls, methods: tuple[str, ...]) -> tuple[str, ...]:
        if not methods or len(set(methods)) != len(methods):
            expected = f"{', '.join(SHIPPED['methods'])}, or module:name"
            raise ValueError(f"name each method once, one or more of {expected}; got {list(methods)}")
        return methods

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        ids = [task.id for task in self.tasks]
        if len(set(ids)) != len(ids):
            raise ValueError(f"tasks have ids {ids}, expected each id once")
        own = [robot.id for robot in self.robots]
        if len(set(own)) != len(own) or not set(own) <= set(self.agents):
            raise ValueError(f"robots have ids {own}, expected each once and of those that tasks have: {self.agents}")
        try:
            self._check_methods()
            _ = self.edges
            self._equip()
        except ConfigurationError as error:
            raise ValueError(str(error)) from error
        if self.learning.init is not None and not (path := self.beside(self.learning.init)).is_file():
            raise ValueError(f"learning.init {path}: no such file; expected a model of a run's weights/")
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
        if not self.files and not any(":" in name for _, name in self.named):
            self._folder = self._prices_folder = None  # two scenarios are equal wherever they were read from
        return self

    def _check_methods(self) -> None:
        names = [kind.name for kind in self._kinds]
        if twice := next((name for name in names if names.count(name) > 1), None):
            called = [named for named, name in zip(self.methods, names, strict=True) if name == twice]
            raise ValueError(f"methods {' and '.join(called)} are both called {twice}, expected a name each")
        both = [kind.name for kind in self._kinds if kind.stage is not None and kind.partners == "datacenter"]
        if both and set(self.meta.adapt_from) - {self.meta.t0}:
            raise ValueError(
                f"meta.adapt_from is {self.meta.adapt_from} and {both[0]} has a stage and the data center in its "
                "rounds: it would have to train and serve at once; expected no such rounds"
            )

    def _check_on_missing(self) -> None:
        if self.federation.on_missing == "wait" and self.energy.has_battery:
            raise ValueError(
                'federation.on_missing is "wait" and a robot has battery_j: its cluster would wait for it once it is '
                'empty; expected "proceed" (or a battery at `report --set energy.battery_j` alone)'
            )
        served = [kind.name for kind in self._kinds if kind.partners == "datacenter"]
        if self.federation.on_missing == "proceed" and served:
            raise ValueError(
                f'federation.on_missing = "proceed" with {", ".join(served)}: expected methods over sidelinks, for who '
                "comes back has missed some"
            )

    @property
    def determines(self) -> str:
        """All that what is learned depends on, as text."""
        priced = ("energy", "robots") if self.energy.has_battery else ()  # with a battery prices end arms
        settings = self.model_dump_json(
            exclude={name: CHANGES_NOTHING[name] for name in CHANGES_NOTHING.keys() - priced}
        )
        beside = getattr(self.factory, "digest", lambda scenario: "")(self)
        return settings + (json.dumps(digests) if (digests := self.learned_by) else "") + beside

    @property
    def method_names(self) -> tuple[str, ...]:
        """What the methods call themselves, in their order."""
        return tuple(kind.name for kind in self._kinds)

    @property
    def meta_methods(self) -> tuple[str, ...]:
        """Names of the methods that train a model in the data center first."""
        return tuple(kind.name for kind in self._kinds if kind.stage is not None)

    @property
    def experience_methods(self) -> tuple[str, ...]:
        """Names of the methods by which robots send raw experience up."""
        return tuple(kind.name for kind in self._kinds if kind.stage is not None or kind.sends == "experience")

    @property
    def is_learned_centrally(self) -> bool:
        """Whether by any method the data center learns a whole cluster's task."""
        return any(kind.sends == "experience" for kind in self._kinds)

    @property
    def needs_datacenter(self) -> bool:
        """Whether any method has work for the data center."""
        return any(kind.stage is not None or kind.partners == "datacenter" for kind in self._kinds)

    @cached_property
    def arms(self) -> tuple[Arm, ...]:
        """What robots do one after the other: each method, from each meta-model that is adapted."""
        return arms_of(self._kinds, self.meta)

    @cached_property
    def arm_names(self) -> tuple[str, ...]:
        """Names of the arms, as they stand in topics."""
        return tuple(arm.name for arm in self.arms)
