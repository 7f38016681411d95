"""A study as a list of jobs: each is one whole deployment, complete in itself so that any machine can run it."""

from __future__ import annotations

import hashlib
import json
import re
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.documents import parse_toml
from jouleswarm.common.scenario.reading import load_scenario, scenario_path
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.methods.consensus import BASELINE
from jouleswarm.studies.tuned import UNTUNED, Tuned


@dataclass(frozen=True)
class Variant:
    """One setting of what a study varies."""

    label: str
    """`what=value`, as it stands in facts.csv and under figures; "" for the scenario as it is."""
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True)
class Job:
    """One deployment: a scenario (TOML text), what is changed in it, and a seed."""

    variant: str
    seed: int
    scenario: str
    overrides: tuple[str, ...]
    files: tuple[tuple[str, bytes], ...] = ()
    """(name, content) of the user's files that the scenario names."""

    @property
    def name(self) -> str:
        """Name of the job's files. Other settings make another name, so facts are never taken for others'."""
        said = [parse_toml(self.scenario), list(self.overrides), self.variant, *self.files]
        digest = hashlib.sha256(json.dumps(said, sort_keys=True, default=str).encode()).hexdigest()[:8]
        label = re.sub(r"[^A-Za-z0-9]+", "-", self.variant).strip("-") or "base"
        return f"{label}-s{self.seed:03d}-{digest}"

    @property
    def settings(self) -> tuple[str, ...]:
        """All overrides, the seed among them."""
        return (*self.overrides, f"seed={self.seed}")

    def load(self) -> Scenario:
        """The scenario as the processes of the deployment will load it.

        Raises:
            ConfigurationError: it cannot be used.
        """
        with tempfile.TemporaryDirectory() as folder:
            return load_scenario(self.write(Path(folder)), self.settings)

    def write(self, folder: Path) -> Path:
        """Write the scenario file that every process of the deployment loads; returns its path."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "scenario.toml"
        path.write_text(self.scenario, encoding="utf-8")
        for name, content in self.files:
            (folder / name).write_bytes(content)
        return path


@dataclass(frozen=True)
class Request:
    """What the user asked for: which scenario, which changes, which seeds."""

    scenario_file: Path
    overrides: tuple[str, ...]
    seeds: tuple[int, ...]
    t0: int
    methods: tuple[str, ...] = ()
    """Those asked for in place of the study's own."""
    tuned: Tuned = UNTUNED
    more_seeds: tuple[int, ...] = ()
    """Of `study paper`: at `t0` and without transfer alone."""

    @property
    def text(self) -> str:
        """The scenario file's text.

        Raises:
            ConfigurationError: it cannot be read.
        """
        try:
            return scenario_path(self.scenario_file).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigurationError(
                f"scenario {self.scenario_file}: cannot be read ({error}); name one with --scenario"
            ) from error

    def scenario(self, settings: Sequence[str], more: Sequence[str] = ()) -> Scenario:
        """The scenario with the study's settings, what is tuned for its methods, the user's changes, then `more`."""
        return load_scenario(self.scenario_file, [*self._with_tuned(settings, more), *self.overrides, *more])

    def _with_tuned(self, settings: Sequence[str], more: Sequence[str]) -> tuple[str, ...]:
        if self.tuned == UNTUNED:
            return tuple(settings)
        untuned = load_scenario(self.scenario_file, [*settings, *self.overrides, *more])
        return (*settings, *self.tuned.of(untuned.method_names))

    @property
    def meta_methods(self) -> tuple[str, ...]:
        """The scenario's own methods of meta-learning, as it names them."""
        _ = self.text  # of a file that is not there, its error says what to do
        scenario = load_scenario(self.scenario_file)
        named = zip(scenario.methods, scenario.method_names, strict=True)
        return tuple(said for said, name in named if name in scenario.meta_methods)

    @property
    def meta_method(self) -> str:
        """The first of them, else MAML."""
        return next(iter(self.meta_methods), "maml")

    def with_plain(self, *own: str) -> list[str]:
        """The methods asked for, or a study's `own`, each once, and learning without transfer."""
        return list(dict.fromkeys([*(self.methods or own), BASELINE]))

    def jobs_by_method(
        self, settings: Sequence[str], variant: Variant, seeds: Sequence[int] | None = None
    ) -> list[Job]:
        """A job a seed (default: all that were asked for) and method of the scenario, so that each is short; what comes
        of them is put together again."""
        methods = self.scenario(settings, variant.overrides).methods
        apart = [Variant(variant.label, (*variant.overrides, methods_setting([method]))) for method in methods]
        return [job for seed in (seeds or self.seeds) for job in self.jobs(apart, settings, [seed])]

    def jobs(
        self, variants: Iterable[Variant], settings: Sequence[str], seeds: Iterable[int] | None = None
    ) -> list[Job]:
        """Every variant under every seed (default: all that were asked for).

        The study's `settings` come first, then what is tuned for the methods, then the user's changes, then the
        variant's own: what a study varies differs between its variants whatever the user has set.
        """
        text, named = self.text, self.scenario(settings).files
        files = tuple((name, path.read_bytes()) for name, path in sorted(named.items()))
        return [
            Job(variant.label, seed, text, (*first, *self.overrides, *variant.overrides), files)
            for variant in variants
            for first in [self._with_tuned(settings, variant.overrides)]
            for seed in (self.seeds if seeds is None else seeds)
        ]


def methods_setting(methods: Iterable[str]) -> str:
    """The override that names the methods of a run."""
    return f"methods={json.dumps(list(methods))}"


def range_of_seeds(count: int, first: int) -> tuple[int, ...]:
    """`count` seeds from `first` on.

    Raises:
        ConfigurationError: `count` is below 1 or `first` below 0.
    """
    if count < 1 or first < 0:
        raise ConfigurationError(f"got {count} seeds from {first} on, expected 1 seed or more, from 0 on or more")
    return tuple(range(first, first + count))
