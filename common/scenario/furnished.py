"""What a scenario has of the user's own: what comes in by doors, and the files that it names."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from pydantic import Field, PrivateAttr

from jouleswarm.common.doors import DOORS, Kind, digest, enter, file_of
from jouleswarm.common.scenario.arms import AnyMethod
from jouleswarm.common.scenario.crew import Crew
from jouleswarm.common.scenario.edges import Edges, read_edges
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.hours import read_hours
from jouleswarm.common.scenario.links import read_links
from jouleswarm.common.scenario.measure import Measure
from jouleswarm.common.scenario.sections import Bus


class Furnished(Crew):
    """A crew with ways to learn, prices and a bus, some of them out of the user's own files."""

    seed: int = Field(1, ge=0, le=2**63 - 1, description="of everything that is drawn: same seed, same bits")
    methods: tuple[str, ...] = Field(
        ("maml", "fl"), description="ways to learn, one after the other: words of docs/methods.md, or module:Class"
    )
    energy: Energy = Energy()
    bus: Bus = Bus()
    measure: Measure = Measure()
    _prices_folder: Path | None = PrivateAttr(None)

    @property
    def folder(self) -> Path | None:
        """Where the files are that the scenario names; None where it names none."""
        return self._folder

    @property
    def named(self) -> tuple[tuple[Kind, str], ...]:
        """What comes in by doors."""
        build = self.network.build
        return (
            ("environments", self.environment),
            *((("networks", build),) if build is not None else ()),
            *(("methods", name) for name in self.methods),
            ("codecs", self.federation.codec),
            ("codecs", self.meta.experience_codec),
            *(("prices", name) for name in self.energy.prices),
        )

    @property
    def files(self) -> dict[str, Path]:
        """Files of the user's own, by their names: what comes in by doors, and what else the scenario names."""
        priced = (path for path in (self.links_path, self._priced(self.energy.carbon_by_hour)) if path is not None)
        return self._files(self.named) | {path.name: path for path in priced}

    def _files(self, named: Iterable[tuple[Kind, str]]) -> dict[str, Path]:
        found = (file_of(name, self._folder_of(kind, name)) for kind, name in named)
        paths = [*(path for path in found if path is not None), *map(self.beside, self.named_files)]
        return {path.name: path for path in paths}

    @property
    def named_files(self) -> tuple[str, ...]:
        """Files that are no doors: a list of edges, a model to begin from."""
        edges = (self.federation.topology,) if self.federation.has_own_edges else ()
        return edges if self.learning.init is None else (*edges, self.learning.init)

    def beside(self, name: str) -> Path:
        """A file that the scenario names, as seen from its own; of a run the file that was kept with it."""
        folder = self._folder or Path()
        given, kept = folder / name, folder / Path(name).name
        return kept if kept.is_file() and (folder.name == DOORS or not given.is_file()) else given

    @property
    def links_path(self) -> Path | None:
        """The user's own table of links; None without."""
        return self._priced(self.energy.links)

    def _priced(self, name: str | None) -> Path | None:
        """A table that prices need, in the folder of their own first."""
        if name is None:
            return None
        first = None if self._prices_folder is None else self._prices_folder / name
        return first if first is not None and first.is_file() else self.beside(name)

    @cached_property
    def edges(self) -> Edges | None:
        """The user's own graph of sidelinks, by task; None where it is drawn by a rule."""
        if not self.federation.has_own_edges:
            return None
        return read_edges(self.beside(self.federation.topology), self.clusters)

    @property
    def digests(self) -> dict[str, str]:
        """SHA-256 of `files`."""
        return {name: digest(path) for name, path in sorted(self.files.items())}

    @property
    def learned_by(self) -> dict[str, str]:
        """Those of `digests` that what is learned depends on: all but prices."""
        files = self._files((kind, name) for kind, name in self.named if kind != "prices")
        return {name: found for name, found in self.digests.items() if name in files}

    def _equip(self) -> None:
        """Give the prices what robots, links and hours have of their own."""
        path, by_hour = self.links_path, self._priced(self.energy.carbon_by_hour)
        links = None if path is None else read_links(path, self.agents)
        hours = () if by_hour is None else read_hours(by_hour)
        vars(self)["energy"] = self.energy.for_fleet(self.robots, links, hours)
        if "distance" in self.energy.prices:
            self.energy.check_places(self.agents)

    def open(self, kind: Kind, name: str) -> Any:
        """What goes by a name of the scenario's (see `common.doors.enter`), the same however its file changes."""
        if (kind, name) not in self.opened:
            self.opened[kind, name] = enter(kind, name, self._folder_of(kind, name))
        return self.opened[kind, name]

    def at(self, energy: Energy, prices_folder: Path | None) -> Self:
        """The same at other prices; price lists and links are looked for in `prices_folder` first, if there is one.

        Raises:
            ConfigurationError: a table of links that cannot be used, or a robot of a kind that there is not.
        """
        other = self.model_copy(update={"energy": energy})
        other._prices_folder = prices_folder
        other._equip()
        vars(other)["opened"] = {key: found for key, found in self.opened.items() if key[0] != "prices"}
        return other

    @cached_property
    def opened(self) -> dict[tuple[Kind, str], Any]:
        """What has been opened so far."""
        return {}

    def _folder_of(self, kind: Kind, name: str) -> Path | None:
        """The folder in which a name's file is looked for."""
        first = self._prices_folder if kind == "prices" else None
        return self._folder if file_of(name, first) is None else first

    @cached_property
    def _kinds(self) -> tuple[type[AnyMethod], ...]:
        return tuple(self.open("methods", name) for name in self.methods)

    def method(self, name: str) -> Any:
        """A new object of one of the scenario's methods, or of one that ships here, by its own name."""
        return (next((kind for kind in self._kinds if kind.name == name), None) or self.open("methods", name))()
