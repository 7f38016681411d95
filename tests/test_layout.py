"""The rules of the layout, held by reading the sources: which package may import what."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
OURS = {"agents", "broker", "common", "datacenter", "fleet", "studies", "benchmarks", "tests"}
# Processes meet on the bus only; the fleet starts them, it does not import them.
MAY_IMPORT = {
    "common": {"common"},
    "agents": {"agents", "common"},
    "broker": {"broker", "common"},
    "datacenter": {"datacenter", "common"},
    "fleet": {"fleet", "common"},
    "studies": {"studies", "fleet", "common"},
}


def imports(source: str) -> Iterator[tuple[int, str]]:
    """(line, module) of every import, late ones inside functions too."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            yield node.lineno, "." * node.level + (node.module or "")


def breaches(package: str, forbidden: set[str], source: str) -> list[tuple[int, str]]:
    """The imports whose first name is forbidden, and the relative ones, which could hide a breach."""
    found = sorted(imports(source))
    return [(line, name) for line, name in found if name.startswith(".") or name.split(".")[0] in forbidden]


def sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


@pytest.mark.parametrize("folder", ["broker", "agents", "datacenter", "common", "fleet", "tests"])
def test_the_fixed_folders_exist_and_hold_sources(folder: str) -> None:
    assert sources(folder)


@pytest.mark.parametrize("package", sorted(MAY_IMPORT))
def test_imports_point_one_way(package: str) -> None:
    forbidden = OURS - MAY_IMPORT[package]
    found = {str(path): breaches(package, forbidden, path.read_text()) for path in sources(package)}
    assert {path: lines for path, lines in found.items() if lines} == {}


@pytest.mark.parametrize("package", sorted(MAY_IMPORT))
def test_mqtt_libraries_stay_behind_the_bus_and_in_the_broker(package: str) -> None:
    for path in sources(package):
        is_bus = package == "common" and path.name.startswith("mqtt")
        allowed = {"amqtt"} if package == "broker" else {"paho"} if is_bus else set()
        forbidden = {"paho", "amqtt", "aiomqtt", "gmqtt"} - allowed
        assert breaches(package, forbidden, path.read_text()) == [], path


def test_a_late_import_across_the_rule_is_found() -> None:
    source = "import os\ndef f():\n    from agents.agent import run_agent\n    import common.bus, broker.core\n"
    assert breaches("fleet", OURS - MAY_IMPORT["fleet"], source) == [(3, "agents.agent"), (4, "broker.core")]


def test_a_relative_import_is_found() -> None:
    assert breaches("fleet", set(), "from ..agents import agent\nfrom . import view\n") == [(1, "..agents"), (2, ".")]
