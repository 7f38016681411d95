"""Link class and phase of the product's own topics, from its rule file: links.toml, beside this."""

from __future__ import annotations

from functools import cache, lru_cache
from pathlib import Path

from jouleswarm.common.wire.rules import Rule, find, read_rules
from jouleswarm.common.wire.topics import Link
from jouleswarm.common.wire.types import RowPhase

OWN = Path(__file__).with_name("links.toml")
_PHASES = {"ml": RowPhase.ML, "fl": RowPhase.FL}


@cache
def own_rules() -> tuple[Rule, ...]:
    """The rules, read once."""
    return tuple(read_rules(OWN))


@lru_cache(10_000)  # topics come again and again; who makes them up must not fill the memory
def _rule_of(topic: str) -> Rule | None:
    return find(own_rules(), topic)


def link_of(topic: str) -> Link | None:
    """Link class of a topic, or None where the topic is not metered (meter reports, foreign topics)."""
    rule = _rule_of(topic)
    return None if rule is None else rule.priced.link


def phase_of(topic: str) -> str:
    """Learning phase that a metered topic's bytes belong to: maml (a stage before), fl (all other learning) or control.

    Written as in rows, whatever the method.
    """
    rule = _rule_of(topic)
    if rule is None or rule.priced.link == Link.CONTROL:
        return "control"
    return _PHASES[rule.priced.phase]
