"""Doors: a scenario names an environment, a network, a method, a codec or a price list, and gets an object.

A plain word is one that ships here, or that an installed package announces as an entry point of the group
`jouleswarm.KIND`. `module:name` is a Python file `module.py` beside the scenario file, or else an installed module. A
file is loaded by its path and no folder is put on `sys.path`: nobody's file can stand in for another module.
"""

from __future__ import annotations

import difflib
import hashlib
import importlib
import importlib.metadata
import importlib.util
import sys
import threading
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

from jouleswarm.common.errors import ConfigurationError

DOORS = "doors"
"""Folder of a run directory with the user's files: what came in by doors, and what a scenario names beside them."""

Kind = Literal["environments", "networks", "methods", "codecs", "prices"]

# By name and not by import: this is the ground floor, and a process loads only what its scenario asks for.
SHIPPED: dict[Kind, dict[str, str]] = {
    "environments": {
        "landmarks": "jouleswarm.environments.landmarks.factory:landmarks",
        "cartpole": "jouleswarm.environments.cartpole:CartPole",
        "minigrid": "jouleswarm.environments.minigrid:minigrid",
    },
    "networks": {
        "mlp": "jouleswarm.learning.qnetwork:mlp",
        "deepmind": "jouleswarm.learning.qnetwork:deepmind",
    },
    "methods": {
        "fl": "jouleswarm.methods.consensus:Federated",
        "isolated": "jouleswarm.methods.consensus:Isolated",
        "fedavg": "jouleswarm.methods.fedavg:FedAvg",
        "centralized": "jouleswarm.methods.centralized:Centralized",
        "maml": "jouleswarm.methods.maml:Maml",
        "fomaml": "jouleswarm.methods.maml:FirstOrderMaml",
        "reptile": "jouleswarm.methods.reptile:Reptile",
        "anil": "jouleswarm.methods.anil:Anil",
        "multitask": "jouleswarm.methods.multitask:Multitask",
    },
    "codecs": {
        "float32": "jouleswarm.codecs.floats:Float32",
        "float16": "jouleswarm.codecs.floats:Float16",
        "int8": "jouleswarm.codecs.int8:Int8",
        "topk": "jouleswarm.codecs.topk:TopK",
        "raw": "jouleswarm.codecs.raw:Raw",
        "png": "jouleswarm.codecs.png:Png",
        "resized": "jouleswarm.codecs.resized:Resized",
    },
    "prices": {
        "literal": "jouleswarm.energy.literal:literal",
        "published": "jouleswarm.energy.published:published",
        "distance": "jouleswarm.energy.distance:distance",
        "frames": "jouleswarm.energy.frames:frames",
        "radio_states": "jouleswarm.energy.radio_states:radio_states",
    },
}

CONTRACTS: dict[Kind, str] = {"methods": "jouleswarm.methods.contract:keep"}
"""Who looks at what a door has opened before anything is asked of it: `module:function` of the room that knows the
contract. It takes what was found and its name in words, and raises ConfigurationError."""

TRIALS: dict[Kind, str] = {
    "codecs": "jouleswarm.codecs.trial:try_codecs",
    "methods": "jouleswarm.methods.trial:try_methods",
}
"""Who tries what a scenario names, when the scenario is read: `module:function` of the room that knows the contract.
It takes the scenario, and raises ConfigurationError."""


_loading = threading.RLock()  # a module is in sys.modules before it is whole


def words(kind: Kind) -> dict[str, str]:
    """Plain words of a door -> `module:name` of what each stands for; what ships here comes first."""
    announced = {point.name: point.value for point in importlib.metadata.entry_points(group=f"jouleswarm.{kind}")}
    return {**announced, **SHIPPED[kind]}


def open_door(kind: Kind, name: str, folder: Path | None) -> Any:
    """The object that `name` stands for; `folder`: of the scenario file.

    Raises:
        ConfigurationError: nothing goes by that name, or its module cannot be imported: one line that says why.
    """
    target = name if ":" in name else SHIPPED[kind].get(name)  # what is announced takes a while to be found
    if target is None and (target := (known := words(kind)).get(name)) is None:
        close = difflib.get_close_matches(name, known, 1)
        hint = f"; did you mean {close[0]}?" if close else ""
        raise ConfigurationError(f"{_one(kind)} {name!r}: expected {_choice(known)} or module:name{hint}")
    module_name, _, attribute = target.partition(":")
    if not attribute or not all(part.isidentifier() for part in (*module_name.split("."), *attribute.split("."))):
        raise ConfigurationError(f"{_one(kind)} {name!r}: expected module:name, for example my_module:MyClass")
    found: Any = _module(kind, name, module_name, folder if ":" in name else None)
    for part in attribute.split("."):
        if not hasattr(found, part):
            close = difflib.get_close_matches(part, [each for each in vars(found) if not each.startswith("_")], 1)
            hint = f"; did you mean {close[0]}?" if close else ""
            where = getattr(found, "__file__", None) or module_name
            raise ConfigurationError(f"{_one(kind)} {name!r}: {where} has no {part}{hint}")
        found = getattr(found, part)
    return found


def enter(kind: Kind, name: str, folder: Path | None) -> Any:
    """What `open_door` finds, once it has been seen to be what the door is for (see `CONTRACTS`).

    Raises:
        ConfigurationError: there is nothing of that name, or it is none.
    """
    found = open_door(kind, name, folder)
    module, _, function = CONTRACTS.get(kind, "").partition(":")
    if module:
        getattr(importlib.import_module(module), function)(found, f"{_one(kind)} {name!r}")
    return found


def trial_of(kind: Kind) -> Callable[[Any], None] | None:
    """Who tries what comes in by a door, if anybody does (see `TRIALS`)."""
    module, _, function = TRIALS.get(kind, "").partition(":")
    found: Callable[[Any], None] | None = getattr(importlib.import_module(module), function) if module else None
    return found


def file_of(name: str, folder: Path | None) -> Path | None:
    """The user's file that a name is looked up in, if it is one beside the scenario file."""
    module, colon, _ = name.partition(":")
    path = folder / f"{module}.py" if colon and folder is not None and module.isidentifier() else None
    return path if path is not None and path.is_file() else None


def digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _module(kind: Kind, name: str, module_name: str, folder: Path | None) -> ModuleType:
    path = file_of(name, folder)
    try:
        return importlib.import_module(module_name) if path is None else _load(path)
    except ConfigurationError:
        raise
    except Exception as error:  # whatever a module of the user's does while it is imported
        if path is None and isinstance(error, ModuleNotFoundError) and error.name == module_name.split(".")[0]:
            beside = f"no {module_name}.py in {folder}" if folder is not None else "no file beside the scenario"
            raise ConfigurationError(f"{_one(kind)} {name!r}: {beside}, and no such module installed") from error
        where = path or module_name
        raise ConfigurationError(
            f"{_one(kind)} {name!r}: {where} cannot be imported: {type(error).__name__}: {error}{_line(error, path)}"
        ) from error


def _load(path: Path) -> ModuleType:
    """A file as a module of its own name, once for each content."""
    key = hashlib.sha256(f"{path.resolve()} {digest(path)}".encode()).hexdigest()
    unique = f"jouleswarm_doors_{key[:16]}_{path.stem}"
    with _loading:
        return sys.modules[unique] if unique in sys.modules else _executed(path, unique)


def _executed(path: Path, unique: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(unique, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[unique] = module  # dataclasses and pydantic look their module up
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[unique]
        raise
    return module


def _line(error: Exception, path: Path | None) -> str:
    if isinstance(error, SyntaxError):
        return ""  # its message has the line
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    return f" (line {lines[-1]})" if lines else ""


def _one(kind: Kind) -> str:
    return {"prices": "price list"}.get(kind, kind.removesuffix("s"))


def _choice(known: Iterable[str]) -> str:
    return ", ".join(sorted(known)) or "a name"
