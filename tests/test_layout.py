"""The rules of the house, held by reading the sources: which room may import what (docs/architecture.md)."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from pathlib import Path

import networkx
import pytest

ROOT = Path(__file__).resolve().parents[1]
HOUSE = ROOT / "jouleswarm"
FIXED = ("agents", "broker", "common", "datacenter")
FLOORS = (
    {"common"},
    {"learning", "codecs", "environments", "energy"},
    {"methods"},
    {"agents", "datacenter", "broker", "metering", "flower", "runs"},
    {"fleet", "report"},
    {"studies", "chaos", "page"},
    {"cli", "simulation"},
    {"__init__", "__main__", "api"},
)
FLOOR_OF = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
FLOOR_OF["__init__"] = len(FLOORS)  # the face names what stands in api
# Processes meet on the bus only; who starts them does so by name.
NEVER = {
    room: {"agents", "datacenter", "broker"} for room in ("fleet", "chaos", "studies", "report", "runs", "page", "cli")
}
LIBRARIES = {"broker": {"amqtt"}, "common": {"paho"}}


def module_of(path: Path) -> str:
    """`agents.agent` of `jouleswarm/agents/agent.py`."""
    parts = path.relative_to(HOUSE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)


def sources() -> dict[str, Path]:
    """Every module of the house, by its name without `jouleswarm`; links are followed."""
    rooms = sorted(each for each in HOUSE.iterdir() if each.is_dir())
    files = [*HOUSE.glob("*.py"), *(file for room in rooms for file in (HOUSE / room.name).rglob("*.py"))]
    return {module_of(file): file for file in files}


def imports(source: str) -> Iterator[tuple[int, str]]:
    """(line, module or name in it) of every import: late ones inside functions, those for type checking too."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                yield node.lineno, f"{'.' * node.level}{node.module or ''}.{alias.name}"


def own(name: str, modules: set[str]) -> str | None:
    """The module of the house that an imported name stands for or is in."""
    if name.split(".")[0] != "jouleswarm":
        return None
    parts = name.split(".")[1:]
    for count in range(len(parts), 0, -1):
        if (module := ".".join(parts[:count])) in modules:
            return module
    return "__init__"


def breaches(module: str, source: str, modules: set[str]) -> list[tuple[int, str]]:
    """Imports that go up, across to another room of the same floor, or by a name that could hide one."""
    room, found = module.split(".")[0], []
    for line, name in imports(source):
        if name.startswith(".") or name.split(".")[0] in FIXED:
            found.append((line, name))
        if (target := own(name, modules)) is None:
            continue
        other = target.split(".")[0]
        across = other != room and FLOOR_OF[other] >= FLOOR_OF[room]
        if across or other in NEVER.get(room, set()):
            found.append((line, name))
    return found


@pytest.mark.parametrize("folder", FIXED)
def test_the_fixed_folders_stand_at_the_top_and_are_rooms_of_the_house(folder: str) -> None:
    assert list((ROOT / folder).glob("*.py"))
    assert (HOUSE / folder).is_symlink()
    assert (HOUSE / folder).resolve() == ROOT / folder


def test_every_room_has_its_floor() -> None:
    assert {module.split(".")[0] for module in sources()} <= set(FLOOR_OF)


def test_imports_go_down_only() -> None:
    modules = sources()
    found = {module: breaches(module, path.read_text(), set(modules)) for module, path in modules.items()}
    assert {module: lines for module, lines in found.items() if lines} == {}


def test_no_files_import_each_other() -> None:
    modules = sources()
    graph = networkx.DiGraph()
    for module, path in modules.items():
        for _, name in imports(path.read_text()):
            if (target := own(name, set(modules))) is not None and target != module:
                graph.add_edge(module, target)
    assert list(networkx.simple_cycles(graph)) == []


def test_mqtt_libraries_stay_behind_the_bus_and_in_the_broker() -> None:
    for module, path in sources().items():
        allowed = LIBRARIES.get(module.split(".")[0], set())
        used = {name.split(".")[0] for _, name in imports(path.read_text())}
        assert used & {"paho", "amqtt", "aiomqtt", "gmqtt"} <= allowed, module


def test_no_process_of_a_run_asks_what_day_it_is() -> None:
    """Clocks of two machines differ: waits are by each one's own, and only what starts and records a run has dates."""
    rooms = {"agents", "datacenter", "broker"}.union(*FLOORS[:3])
    asked = {"time.time", "time.time_ns", "datetime.now", "datetime.datetime.now", "datetime.utcnow", "date.today"}
    for module, path in sources().items():
        if module.split(".")[0] in rooms and module != "agents.memory":  # which leaves a date for people
            calls = {
                ast.unparse(node.func) for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)
            }
            assert not calls & asked, module


def test_every_test_is_below_a_path_that_is_tested() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]["ini_options"]
    tested = {ROOT / path for path in settings["testpaths"]}
    tests = set((ROOT / "tests").rglob("test_*.py"))
    assert {test for test in tests if not tested & {test, *test.parents}} == set()


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("from jouleswarm.agents.robot import run_agent", "jouleswarm.agents.robot.run_agent"),
        ("import jouleswarm.broker.core", "jouleswarm.broker.core"),
        ("from agents.agent import run_agent", "agents.agent.run_agent"),
        ("from ..agents import agent", "..agents.agent"),
        ("from jouleswarm.studies import run", "jouleswarm.studies.run"),
    ],
)
def test_a_late_import_across_the_rule_is_found(line: str, found: str) -> None:
    source = f"import os\ndef f():\n    {line}\n    from jouleswarm.common.bus import bus\n"
    assert breaches("fleet.deploy", source, set(sources())) == [(3, found)]


def test_files_and_functions_are_short() -> None:
    found = {}
    for module, path in sources().items():
        text = path.read_text(encoding="utf-8")
        functions = [each for each in ast.walk(ast.parse(text)) if isinstance(each, ast.FunctionDef)]
        lines = {each.name: (each.end_lineno or 0) - each.lineno + 1 for each in functions}
        if len(text.splitlines()) > 250 or any(length > 60 for length in lines.values()):
            found[module] = {name: length for name, length in lines.items() if length > 60}
    assert found == {}
