"""What is to be learned: an environment, its tasks, and the network that learns them."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ConfigDict, Field, PrivateAttr, ValidationInfo, model_validator

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.environments import LANDMARKS, called, factory_of, make, spaces_of, with_own
from jouleswarm.common.scenario.sections import Network, Section, Task
from jouleswarm.common.scenario.spaces import Interface, Spaces
from jouleswarm.common.scenario.stored import as_written

T = TypeVar("T")


class Problem(Section):
    """The part of a scenario that its environment has a say in. Tables that are the environment's own stand beside."""

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    name: str = Field(
        pattern=r"^[A-Za-z0-9_.-]+$",
        max_length=200,
        description="of the run on the bus, and the beginning of its folder's",
    )
    note: str = Field("", max_length=300, description="what a reader of its answer is told beside it")
    environment: str = Field(
        LANDMARKS, max_length=200, description="landmarks, cartpole, minigrid, module:factory or a Gymnasium id"
    )
    tasks: tuple[Task, ...] = Field(min_length=1, max_length=1000)
    network: Network = Network()
    _folder: Path | None = PrivateAttr(None)

    def model_post_init(self, context: Any) -> None:
        """Remember where files are that the scenario names (see `common.doors`), and sizes that are known already."""
        self._folder = (context or {}).get("folder")
        if (interface := (context or {}).get("interface")) is not None:
            self.remember(interface)

    @model_validator(mode="before")
    @classmethod
    def _own_tables(cls, data: Any, info: ValidationInfo) -> Any:
        name, folder = data.get("environment", LANDMARKS), (info.context or {}).get("folder")
        if not isinstance(name, str):
            return data
        try:
            factory, is_known = factory_of(name, folder), True
        except ConfigurationError:
            if (info.context or {}).get("interface") is None:
                raise
            factory, is_known = None, False  # a run that was begun: its report needs no environment
        if (info.context or {}).get("stored"):
            data = as_written(data, factory)
        return with_own(factory, data, cls.model_fields, folder) if is_known else data

    @property
    def factory(self) -> Any | None:
        """What makes the environment (see `common.scenario.environments`); None: a Gymnasium id."""
        return factory_of(self.environment, self._folder)

    def own(self, name: str, kind: type[T]) -> T:
        """A table of the scenario that is its environment's own.

        Raises:
            ConfigurationError: its environment has none such.
        """
        found = (self.model_extra or {}).get(name)
        if not isinstance(found, kind):
            raise ConfigurationError(
                f"environment {self.environment!r} has no table [{name}]: this is for {LANDMARKS!r} only"
            )
        return found

    def task(self, task: int) -> Task:
        """The task with id `task`."""
        return next(each for each in self.tasks if each.id == task)

    def make(self, task: int) -> Any:
        """A task's environment, a gymnasium.Env.

        Raises:
            ConfigurationError: it cannot be made; one line that says why.
        """
        factory = self.factory
        if (of_task := getattr(factory, "of_task", None)) is not None:
            return of_task(self, task)
        tables = {name: self.own(name, kind) for name, kind in getattr(factory, "sections", {}).items()}
        return make(self.environment, factory, self.task(task), tables)

    def share(self) -> object:
        """What the environment has its robots share in memory, made for who is forked then; None: nothing.

        Raises:
            ConfigurationError: it fails at that; one line that says why.
        """
        share = getattr(self.factory, "share", None)
        return None if share is None else called(share, self, f"environment {self.environment!r}: share() fails")

    @cached_property
    def known(self) -> list[tuple[tuple[Any, ...], Interface | Spaces]]:
        """Sizes that have been found out, each with the settings that it holds for."""
        return []

    @property
    def interface(self) -> Interface | None:
        """All sizes, where they are known without building the network: of a run that was begun."""
        return next((known for known in self._known() if isinstance(known, Interface)), None)

    @property
    def known_spaces(self) -> Spaces | None:
        """Of the environment, where they are known without making it."""
        for known in self._known():
            return known.spaces if isinstance(known, Interface) else known
        told = getattr(self.factory, "spaces", None)
        return None if told is None else told(self)

    @property
    def spaces(self) -> Spaces:
        """Of the environment: of its first task, as all have the same.

        Raises:
            ConfigurationError: it cannot be made, or is none to learn Q-values of.
        """
        if (known := self.known_spaces) is not None:
            return known
        first = self.tasks[0].id
        environment = self.make(first)
        found = spaces_of(environment, f"environment {self.environment!r}, task {first}")
        environment.close()
        self.known.append((self._sized, found))
        return found

    def remember(self, interface: Interface) -> None:
        """Sizes that have been found out elsewhere."""
        self.known.append((self._sized, interface))

    def _known(self) -> list[Interface | Spaces]:
        return [found for settings, found in self.known if settings == self._sized]

    @property
    def _sized(self) -> tuple[Any, ...]:
        """All that sizes depend on: a copy with other settings may have others."""
        return self.environment, self.tasks, self.network, *(self.model_extra or {}).items()
