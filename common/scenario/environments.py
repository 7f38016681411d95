"""The environment door: whose tables of a scenario are whose, and a task's environment opened by its name.

What a name stands for is a factory: called with a task's kwargs it gives a gymnasium.Env. It may carry, all optional:

- `sections`: table of the scenario -> its pydantic model. They are the environment's own, and are handed to it by name.
- `task`: pydantic model of fields that a task has beside `id`, `robots` and `kwargs`.
- `defaults`: table -> values of the core's settings where the scenario names none.
- `earlier`: table -> values of settings that its written scenarios may lack (see `common.scenario.stored`).
- `of_task(scenario, task)`: gives the environment in place of the call, for who needs to know the whole scenario.
- `spaces(scenario)`: `Spaces` from the settings alone; else the first task's environment is made to know them.
- `check(scenario)`: yields a line for each thing that does not fit together.
- `digest(scenario)`: text of whatever else the environment depends on, files for example.
- `resolve(data, folder)`: the scenario's data with paths that hold from anywhere.
- `share(scenario)`: makes, and returns, what all robots of a machine may share in memory: called once in the process
  that they are forked from; must start no thread.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import create_model

from jouleswarm.common.doors import open_door, words
from jouleswarm.common.errors import ConfigurationError, JouleSwarmError
from jouleswarm.common.scenario.sections import Section, Task
from jouleswarm.common.scenario.spaces import Observation, Spaces

LANDMARKS = "landmarks"
"""What a scenario that names no environment has."""
MAX_ACTIONS = 10_000


def factory_of(name: str, folder: Path | None) -> Any | None:
    """What a name stands for; None for Gymnasium's own, which is only known once it is made.

    Raises:
        ConfigurationError: a module that cannot be imported, or has no such factory.
    """
    module, colon, attribute = name.partition(":")
    is_target = colon and all(part.isidentifier() for part in (*module.split("."), *attribute.split(".")))
    if not is_target and name != LANDMARKS and name not in words("environments"):
        return None
    factory = open_door("environments", name, folder)
    if not callable(factory) and not hasattr(factory, "of_task"):
        raise ConfigurationError(f"environment {name!r}: got a {type(factory).__name__}, expected a factory to call")
    return factory


def with_own(factory: Any, given: Mapping[str, Any], core: Mapping[str, Any], folder: Path | None) -> dict[str, Any]:
    """A scenario's data with the environment's own tables and fields of tasks checked, and its defaults filled in.

    Args:
        factory: as `factory_of` gives it.
        given: of the scenario.
        core: names of the core's fields.
        folder: of the scenario file.

    Raises:
        pydantic.ValidationError: a table or field is wrong, or nobody's.
    """
    data: dict[str, Any] = getattr(factory, "resolve", lambda data, folder: data)(dict(given), folder)
    for section, values in getattr(factory, "defaults", {}).items():
        held = data.get(section, {})
        if isinstance(held, Mapping):
            data[section] = {**values, **{key: value for key, value in held.items() if value is not None}}
    tasks = data.get("tasks", ())
    if not isinstance(tasks, list | tuple) or not all(isinstance(task, Mapping) for task in tasks):
        return data  # the core says what it expects
    fields = [{key: value for key, value in task.items() if key not in Task.model_fields} for task in tasks]
    others = {key: value for key, value in data.items() if key not in core}
    own = own_model(factory).model_validate({**others, "tasks": fields})
    tables = {name: getattr(own, name) for name in type(own).model_fields}
    pairs = zip(tasks, tables.pop("tasks"), strict=True)
    merged = [{**task, **{name: getattr(own, name) for name in type(own).model_fields}} for task, own in pairs]
    return data | tables | ({"tasks": merged} if "tasks" in data else {})


@lru_cache(maxsize=16)
def own_model(factory: Any) -> type[Section]:
    """Of the tables that are the environment's own, and of the fields that its tasks have beside the core's."""
    sections: dict[str, Any] = {name: (kind, kind()) for name, kind in getattr(factory, "sections", {}).items()}
    task: Any = getattr(factory, "task", Section)
    return create_model("Own", __base__=Section, tasks=(tuple[task, ...], ()), **sections)


def make(name: str, factory: Any | None, task: Task, tables: Mapping[str, Any]) -> Any:
    """A task's gymnasium.Env by calling what makes it; `tables`: the scenario's that are the environment's own.

    Raises:
        ConfigurationError: it cannot be made; one line that says why.
    """
    import gymnasium

    what = f"environment {name!r}, task {task.id}"
    try:
        if factory is None:
            made = gymnasium.make(name, disable_env_checker=True, **task.kwargs)
        else:
            made = factory(**task.kwargs, **(task.model_extra or {}), **tables)
    except JouleSwarmError:
        raise
    except (gymnasium.error.NameNotFound, gymnasium.error.NamespaceNotFound) as error:
        raise ConfigurationError(f"environment {name!r}: {_unknown(name)}") from error
    except Exception as error:  # whatever a factory of the user's does
        given = f" (kwargs: {', '.join(task.kwargs)})" if isinstance(error, TypeError) and task.kwargs else ""
        raise ConfigurationError(f"{what}: {type(error).__name__}: {first_line(error)}{given}") from error
    if not isinstance(made, gymnasium.Env):
        raise ConfigurationError(f"{what}: got a {type(made).__name__}, expected a gymnasium.Env")
    return made


def called(function: Any, argument: Any, what: str) -> Any:
    """What a function of the user's gives; `what` begins the line that says why it fails.

    Raises:
        ConfigurationError: it does.
    """
    try:
        return function(argument)
    except JouleSwarmError:
        raise
    except Exception as error:  # whatever it does
        raise ConfigurationError(f"{what}: {type(error).__name__}: {first_line(error)}") from error


def first_line(error: BaseException) -> str:
    """What an error says, as far as a line goes."""
    return (str(error).strip().splitlines() or [""])[0][:300]


def spaces_of(environment: Any, what: str) -> Spaces:
    """The spaces of a gymnasium.Env; `what` names it in errors.

    Raises:
        ConfigurationError: they are none that a Q-network can be made for.
    """
    from gymnasium import spaces

    action = environment.action_space
    if not isinstance(action, spaces.Discrete):
        kind = "continuous actions, " if isinstance(action, spaces.Box) else ""
        raise ConfigurationError(f"{what}: {kind}action space {action}; expected Discrete, a value for each action")
    count = int(action.n)
    if count > MAX_ACTIONS:
        raise ConfigurationError(f"{what}: {count} actions, expected {MAX_ACTIONS} at most")
    told = environment.metadata or {}
    names = tuple(map(str, told.get("actions", range(count))))
    if len(names) != count:
        raise ConfigurationError(f'{what}: metadata["actions"] names {len(names)}, expected {count}, one for each')
    channels = told.get("channels")
    return Spaces(
        observation=_observation(environment.observation_space, what),
        actions=names,
        channels=tuple(map(str, channels)) if channels else None,
    )


def _observation(space: Any, what: str) -> Observation:
    from gymnasium import spaces

    if isinstance(space, spaces.Discrete):
        return Observation(shape=(), dtype=np.dtype(space.dtype).name, values=int(space.n))
    if not isinstance(space, spaces.Box):
        raise ConfigurationError(
            f"{what}: observation space {first_line(ValueError(space))}; expected Box or Discrete: wrap it, for "
            "example in gymnasium.wrappers.FlattenObservation"
        )
    dtype = np.dtype(space.dtype)
    if dtype.kind not in "buif" or dtype.itemsize > 8:
        raise ConfigurationError(f"{what}: observations of {dtype}, expected integers or floats of 8 bytes at most")
    return Observation(shape=tuple(map(int, space.shape)), dtype=dtype.name)


def _unknown(name: str) -> str:
    import gymnasium

    known = [*words("environments"), *gymnasium.registry]
    close = difflib.get_close_matches(name, known, 1, 0.5)
    hint = f"; did you mean {close[0]}?" if close else ""
    return f"expected {', '.join(sorted(words('environments')))}, module:factory or a Gymnasium id{hint}"
