"""A complete run that goes on for more rounds, from how its arms ended: `jouleswarm run --keep-state` keeps that."""

from __future__ import annotations

import datetime
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario, with_overrides
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.names import client_of
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.runs.directory import MANIFEST, STATE, SUMMARY, RunDirectory
from jouleswarm.runs.files import run_manifest

_LIMITS = ("max_rounds", "target_reward")
_HELP = "expected higher federation.max_rounds or target_reward"


@dataclass(frozen=True)
class MoreRounds:
    """A run's scenario as it is to go on."""

    scenario: Scenario
    before: dict[str, float]
    """`max_rounds` and `target_reward` so far."""

    def begin(self, directory: RunDirectory) -> None:
        """Write down that the run goes on; its manifest remembers what its limits were."""
        manifest: dict[str, Any] = json.loads((directory.path / MANIFEST).read_text(encoding="utf-8"))
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        manifest["scenario"] = self.scenario.model_dump(mode="json")
        manifest["continued"] = [*manifest.get("continued", ()), {"at": now, **self.before}]
        directory.manifest(manifest)
        directory.begin_again(self._is_over)

    def _is_over(self, row: RoundRow) -> bool:
        return row.is_over(self.scenario.federation.max_rounds, self.scenario.federation.target_reward)


def has_ends(path: Path) -> bool:
    """Whether a run keeps how its arms end, as far as it has got."""
    return any((path / STATE).glob("agent-*/end-*.0"))


def with_more_rounds(path: Path, settings: Sequence[str]) -> MoreRounds:
    """A complete run's scenario with `section.key=value` settings that let it go on.

    Raises:
        ConfigurationError: it is not complete or does not keep how its arms ended, or the settings change something
            else, or nothing, or ask for less.
    """
    run_manifest(path)
    scenario = load_scenario(path / MANIFEST)
    try:
        status = json.loads((path / SUMMARY).read_text(encoding="utf-8"))["status"]
    except (OSError, ValueError, KeyError):
        status = "interrupted"
    if status != "complete":
        raise ConfigurationError(f"run {path}: is {status}; --resume without --set first, then with more rounds")
    arms = [(agent, arm) for agent in scenario.agents for arm in scenario.arm_names]
    if not all((path / STATE / client_of(agent) / f"end-{arm}.0").exists() for agent, arm in arms):
        raise ConfigurationError(f"run {path}: does not keep how its arms ended; run the scenario with --keep-state")
    return _checked(scenario, with_overrides(scenario, settings, str(path)), path)


def _checked(before: Scenario, after: Scenario, path: Path) -> MoreRounds:
    limits = {name: getattr(before.federation, name) for name in _LIMITS}
    rest = after.model_dump(mode="json")
    rest["federation"] |= limits
    if rest != before.model_dump(mode="json"):
        raise ConfigurationError(f"run {path}: --set changes more than how long it goes on; {_HELP} alone")
    asked = {name: getattr(after.federation, name) for name in _LIMITS}
    if asked == limits or any(asked[name] < limits[name] for name in _LIMITS):
        told = ", ".join(f"{name} {asked[name]:g} after {limits[name]:g}" for name in _LIMITS)
        raise ConfigurationError(f"run {path}: {told}; {_HELP}")
    return MoreRounds(after, limits)
