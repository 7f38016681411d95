"""Rules that say of anybody's topics which link they are moved over: `links.toml`. Pure but for reading the file.

    "fed/+round/+client/up" = { link = "uplink" }
    "fed/+round/model" = { link = "downlink", phase = "fl" }
    "peers/+sender/#rest" = [{ link = "uplink", receiver = "server*" }, { link = "sidelink" }]

The keys are topic filters; `+name` and `#name` make a column of what stands there. The first rule that matches counts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.documents import parse_toml
from jouleswarm.common.scenario.sections import Section
from jouleswarm.common.scenario.tables import first_error
from jouleswarm.common.wire.filters import Levels, covers, is_filter, matches
from jouleswarm.common.wire.topics import Link

OTHER = "other"
"""The link of what no rule matches."""
_NAMED = re.compile(r"([+#])([A-Za-z_]\w*)")
_MOST_RULES = 200


class Priced(Section):
    """What a rule says of the topics that its filter matches."""

    link: Link
    phase: Literal["ml", "fl"] = "fl"
    sender: str | None = Field(None, min_length=1)
    """Client ids of those who publish, * for any run of characters; None: all, known or not."""
    receiver: str | None = Field(None, min_length=1)


@dataclass(frozen=True)
class Rule:
    """One line of the file."""

    text: str
    """The filter as it was written."""
    levels: Levels
    """The same without names."""
    names: Mapping[str, int]
    """Name -> its level, from 0."""
    priced: Priced
    line: int

    def applies(self, topic: Levels, sender: str | None, receiver: str | None) -> bool:
        """Whether it matches a packet; a client that is not known, None, is none that a pattern asks for."""
        priced = self.priced
        return matches(self.levels, topic) and _fits(priced.sender, sender) and _fits(priced.receiver, receiver)

    def hides(self, other: Rule) -> bool:
        """Whether what `other` matches is always matched by this one."""
        mine, theirs = self.priced, other.priced
        ends = ((mine.sender, theirs.sender), (mine.receiver, theirs.receiver))
        # A pattern covers another if it matches its text: only its own * can take up that one's *.
        return covers(self.levels, other.levels) and all(_fits(wide, narrow) for wide, narrow in ends)

    def labels(self, topic: Levels) -> dict[str, str]:
        """What stands at the named levels of a topic that it matches."""
        rest = len(self.levels) - 1 if self.levels[-1] == "#" else len(topic)
        return {
            name: "/".join(topic[place : None if place == rest else place + 1]) for name, place in self.names.items()
        }


def find(rules: Sequence[Rule], topic: str, sender: str | None = None, receiver: str | None = None) -> Rule | None:
    """The first rule that matches; None: its bytes are OTHER."""
    levels = tuple(topic.split("/"))
    return next((rule for rule in rules if rule.applies(levels, sender, receiver)), None)


def read_rules(path: Path) -> list[Rule]:
    """The rules of a file, in their order.

    Raises:
        ConfigurationError: one line with the file's line number.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"rules {path}: cannot be read ({error})") from error
    return parse_rules(text, path)


def parse_rules(text: str, path: Path | str) -> list[Rule]:
    """The same of a file's text; `path` stands in errors.

    Raises:
        ConfigurationError: one line with the file's line number.
    """
    try:
        table = parse_toml(text)
    except ValueError as error:
        raise ConfigurationError(f"rules {path}: cannot be read ({error})") from error
    rules = list(_rules(table, text.splitlines(), path))
    if not 0 < len(rules) <= _MOST_RULES:
        wanted = f"from 1 to {_MOST_RULES}, each as \"fed/+client/up\" = {{ link = 'uplink' }}"
        raise ConfigurationError(f"rules {path}: {len(rules)} of them, expected {wanted}")
    for place, rule in enumerate(rules):
        for before in rules[:place]:
            if before.hides(rule):
                raise ConfigurationError(
                    f"{path}, line {rule.line}: {rule.text!r} can never be reached, for {before.text!r} in line "
                    f"{before.line} matches all of it before; expected the narrower one first"
                )
    return rules


def _rules(table: Mapping[str, Any], lines: Sequence[str], path: Path | str) -> Iterator[Rule]:
    for text, value in table.items():
        line = next((at for at, each in enumerate(lines, 1) if f'"{text}"' in each or f"'{text}'" in each), 0)
        line = line or next((at for at, each in enumerate(lines, 1) if text in each), 1)
        where = f"{path}, line {line}"
        levels, names = _filter(text, where)
        for one in value if isinstance(value, list) else [value]:
            try:
                yield Rule(text, levels, names, _priced(one, where), line)
            except ValidationError as error:
                raise ConfigurationError(f"{where}: {text!r}: {first_error(error)}") from None


def _priced(value: Any, where: str) -> Priced:
    priced = Priced.model_validate(value)
    if priced.sender and priced.receiver:
        raise ConfigurationError(f"{where}: sender and receiver; a packet tells only one of them, expected one")
    return priced


def _filter(text: str, where: str) -> tuple[Levels, dict[str, int]]:
    """Levels without names, and where the names stand."""
    levels, names = [], dict[str, int]()
    for place, level in enumerate(text.split("/")):
        named = _NAMED.fullmatch(level)
        if named and names.setdefault(named[2], place) != place:
            raise ConfigurationError(f"{where}: {text!r} names two levels {named[2]}, expected each name once")
        levels.append(named[1] if named else level)
    if not text or not is_filter(tuple(levels)):
        raise ConfigurationError(
            f"{where}: {text!r} is no topic filter, expected + or +name alone in a level, # or #name in the last only"
        )
    return tuple(levels), names


def _fits(pattern: str | None, client: str | None) -> bool:
    if pattern is None:
        return True
    parts = map(re.escape, pattern.split("*"))
    return client is not None and re.fullmatch(".*".join(parts), client, re.DOTALL) is not None
