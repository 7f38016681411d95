"""Topic rights in the format of Mosquitto's acl_file (mosquitto.conf(5)), as pure functions.

    user NAME                                        the lines below are NAME's
    topic [read|write|readwrite|deny] FILTER         readwrite where nothing is said
    pattern [read|write|readwrite|deny] FILTER       for all users; %u is the user, %c the client id

Lines that begin with # are comments. What no line permits is forbidden; a deny line comes before any other. As in
Mosquitto the topic lines of a user are asked first, then the pattern lines.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import IntFlag
from typing import NamedTuple

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire.filters import Levels, covers, is_filter, matches


class Access(IntFlag):
    """What a rule permits; nothing where it denies."""

    DENY = 0
    READ = 1
    WRITE = 2


_ACCESS = {
    "read": Access.READ,
    "write": Access.WRITE,
    "readwrite": Access.READ | Access.WRITE,
    "deny": Access.DENY,
}


class Rule(NamedTuple):
    """Access to the topics that a filter matches."""

    access: Access
    levels: Levels


class Rights(NamedTuple):
    """A rights file. Rules before the first `user` line are those of clients without a user."""

    users: dict[str, tuple[Rule, ...]]
    patterns: tuple[Rule, ...]

    def of(self, user: str, client_id: str) -> tuple[tuple[Rule, ...], ...]:
        """The groups of rules that one client goes by, in the order of asking."""
        own = self.users.get(user, ())
        if any(char in name for name in (user, client_id) for char in "+#/"):
            return (own,)  # would widen a pattern
        filled = (tuple(_fill(level, user, client_id) for level in rule.levels) for rule in self.patterns)
        return own, tuple(Rule(rule.access, levels) for rule, levels in zip(self.patterns, filled, strict=True))


def parse_rights(text: str, source: str = "rights") -> Rights:
    """Read a rights file.

    Raises:
        ConfigurationError: a line is none of the format; the message names it.
    """
    users: dict[str, list[Rule]] = {"": []}
    patterns: list[Rule] = []
    rules = users[""]
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.strip()
        if not line or line.startswith("#"):
            continue
        keyword, _, rest = line.partition(" ")
        rest = rest.strip()
        if keyword == "user" and rest:
            rules = users.setdefault(rest, [])
        elif keyword in ("topic", "pattern") and rest:
            into = rules if keyword == "topic" else patterns
            into.append(_parse_rule(rest, f"{source}, line {number}"))
        else:
            raise ConfigurationError(
                f"{source}, line {number}: got {line!r}; expected 'user NAME', 'topic [read|write|readwrite|deny] "
                "FILTER' or 'pattern ...'"
            )
    return Rights({user: tuple(own) for user, own in users.items()}, tuple(patterns))


def permits(groups: Iterable[Iterable[Rule]], access: Access, topic: str) -> bool:
    """Whether a message may be published (WRITE) on `topic`, or delivered (READ) from it."""
    levels = tuple(topic.split("/"))
    return _decide(groups, access, lambda rule: matches(rule.levels, levels))


def permits_filter(groups: Iterable[Iterable[Rule]], topic_filter: str) -> bool:
    """Whether one rule permits to read all topics that `topic_filter` matches."""
    levels = tuple(topic_filter.split("/"))
    return _decide(groups, Access.READ, lambda rule: covers(rule.levels, levels))


def _parse_rule(text: str, where: str) -> Rule:
    word, _, rest = text.partition(" ")
    access, topic_filter = (_ACCESS[word], rest.strip()) if rest and word in _ACCESS else (_ACCESS["readwrite"], text)
    levels = tuple(topic_filter.split("/"))
    if not is_filter(levels):
        raise ConfigurationError(
            f"{where}: got the filter {topic_filter!r}; expected + and # alone in their levels, # in the last one only"
        )
    return Rule(access, levels)


def _fill(level: str, user: str, client_id: str) -> str:
    return level.replace("%u", user).replace("%c", client_id)


def _decide(groups: Iterable[Iterable[Rule]], access: Access, applies: Callable[[Rule], bool]) -> bool:
    for rules in groups:
        found = [rule.access for rule in rules if applies(rule)]
        if Access.DENY in found:
            return False
        if any(each & access for each in found):
            return True
    return False
