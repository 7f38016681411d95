"""Topic filters (MQTT 3.1.1, section 4.7), by their levels."""

from __future__ import annotations

Levels = tuple[str, ...]


def is_filter(levels: Levels) -> bool:
    """Whether wildcards fill their levels, and # is the last one."""
    alone = all(level in ("+", "#") or not set(level) & set("+#") for level in levels)
    return alone and "#" not in levels[:-1]


def matches(topic_filter: Levels, topic: Levels) -> bool:
    """Whether a filter matches a topic."""
    if topic[0].startswith("$") and topic_filter[0] in ("+", "#"):
        return False
    for place, level in enumerate(topic_filter):
        if level == "#":
            return True
        if place >= len(topic) or level not in ("+", topic[place]):
            return False
    return len(topic_filter) == len(topic)


def covers(wide: Levels, narrow: Levels) -> bool:
    """Whether every topic that the filter `narrow` matches is matched by the filter `wide`."""
    if narrow[0].startswith("$") and wide[0] in ("+", "#"):
        return False
    for place, level in enumerate(wide):
        if level == "#":
            return True
        if place >= len(narrow) or narrow[place] == "#" or level not in ("+", narrow[place]):
            return False
    return len(wide) == len(narrow)
