"""Topic rights: the file's format, what a rule matches, what a right covers."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jouleswarm.broker.access import CACHED_TOPICS, Book, Grants, parse_users
from jouleswarm.broker.rights import Access, covers, matches, parse_rights, permits, permits_filter
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire import topics

FILE = """
# A comment
topic read public/#
user agent-1
topic write own/1
topic own/both
topic deny own/both/secret
  topic read own/+/#

user agent 2
topic readwrite with space/x
pattern write mine/%u
pattern read session/%c/+
"""
ID = "agent-1.00ff00ff"


def of(user: str, client_id: str = ID):
    return parse_rights(FILE).of(user, client_id)


@pytest.mark.parametrize(
    ("user", "access", "topic", "allowed"),
    [
        ("agent-1", Access.WRITE, "own/1", True),
        ("agent-1", Access.READ, "own/1", True),  # by own/+/#, which matches own/1 too
        ("agent-1", Access.WRITE, "own/both", True),
        ("agent-1", Access.READ, "own/both/secret", False),
        ("agent-1", Access.WRITE, "own/2", False),
        ("agent-1", Access.READ, "public/x", False),
        ("", Access.READ, "public/x", True),
        ("", Access.READ, "public", True),
        ("agent 2", Access.WRITE, "with space/x", True),
        ("agent-1", Access.WRITE, "mine/agent-1", True),
        ("agent-1", Access.WRITE, "mine/agent 2", False),
        ("agent-1", Access.READ, f"session/{ID}/x", True),
        ("agent-1", Access.READ, "session/agent-1/x", False),
        ("nobody", Access.WRITE, "own/1", False),
        ("nobody", Access.WRITE, "mine/nobody", True),
    ],
)
def test_a_rights_file_permits_what_its_lines_say(user: str, access: Access, topic: str, allowed: bool) -> None:
    assert permits(of(user), access, topic) is allowed


def test_a_users_own_line_comes_before_a_pattern_that_denies() -> None:
    rights = parse_rights("user a\ntopic read x\npattern deny x\n")
    assert permits(rights.of("a", "a"), Access.READ, "x")
    assert not permits(rights.of("b", "b"), Access.READ, "x")


@pytest.mark.parametrize("user", ["+", "#", "a/b"])
def test_a_name_with_a_wildcard_does_not_widen_a_pattern(user: str) -> None:
    assert not permits(parse_rights("pattern write mine/%u").of(user, ID), Access.WRITE, "mine/other")


@pytest.mark.parametrize(
    "line",
    [
        *("topic", "user", "pattern ", "allow read x", "topic read a/#/b", "topic read a#", "topic write +a/b"),
        *("topic +#", "usr x"),
    ],
)
def test_a_line_that_is_no_right_is_named(line: str) -> None:
    with pytest.raises(ConfigurationError, match=r"^acl, line 2: "):
        parse_rights(f"user a\n{line}\n", "acl")


@pytest.mark.parametrize(
    ("wide", "narrow", "covered"),
    [
        ("a/+/c", "a/+/c", True),
        ("a/+/c", "a/b/c", True),
        ("a/b/c", "a/+/c", False),
        ("a/+", "a/#", False),
        ("a/#", "a/#", True),
        ("a/#", "a", True),
        ("a/#", "a/+/c", True),
        ("a/+/c", "#", False),
        ("#", "#", True),
        ("#", "$SYS/#", False),
        ("+/x", "$SYS/x", False),
        ("a/+/c", "a/+", False),
        ("a/+", "a/+/c", False),
    ],
)
def test_a_filter_is_granted_only_within_a_right(wide: str, narrow: str, covered: bool) -> None:
    assert permits_filter(parse_rights(f"user u\ntopic read {wide}").of("u", "u"), narrow) is covered


def naive(topic_filter: str, topic: str) -> bool:
    """MQTT 3.1.1, section 4.7, as a regular expression."""
    if topic.startswith("$") and topic_filter[0] in "+#":
        return False
    if topic_filter == "#":
        return True
    body, tail = (topic_filter[:-2], "(/.*)?") if topic_filter.endswith("/#") else (topic_filter, "")
    levels = ("[^/]*" if level == "+" else re.escape(level) for level in body.split("/"))
    return re.fullmatch("/".join(levels) + tail, topic, re.DOTALL) is not None


NAMES = st.sampled_from(["", "a", "b", "$s"])
TOPICS = st.lists(NAMES, min_size=1, max_size=4).map("/".join).filter(bool)
FILTERS = st.builds(
    lambda levels, tail: "/".join([*levels, *tail]),
    st.lists(NAMES | st.just("+"), max_size=4),
    st.sampled_from([(), ("#",)]),
).filter(bool)


@settings(deadline=None)
@given(topic_filter=FILTERS, topic=TOPICS)
def test_a_filter_matches_as_the_naive_matcher_does(topic_filter: str, topic: str) -> None:
    assert matches(tuple(topic_filter.split("/")), tuple(topic.split("/"))) is naive(topic_filter, topic)


@settings(deadline=None)
@given(wide=FILTERS, narrow=FILTERS, topic=TOPICS)
def test_nothing_comes_by_a_covered_filter_that_the_right_does_not_match(wide: str, narrow: str, topic: str) -> None:
    if covers(tuple(wide.split("/")), tuple(narrow.split("/"))) and naive(narrow, topic):
        assert naive(wide, topic)


def grants_of(rights: str, told: list[str]) -> Grants:
    """Of the user `a`."""
    guard: Any = SimpleNamespace(book=Book({"a": "hash"}, parse_rights(rights)))
    return Grants(guard, "a", "a", "hash", told.append)


def test_what_was_decided_is_kept_up_to_a_limit_and_each_refusal_told_once() -> None:
    told: list[str] = []
    grants = grants_of("user a\ntopic write own/+", told)
    for _ in range(3):
        assert grants.may_publish("own/1")
        assert not grants.may_publish("other")
    assert told == ["publish on other"]
    for number in range(3 * CACHED_TOPICS):
        assert grants.may_publish(f"own/{number}")
    assert len(grants._publish) <= CACHED_TOPICS


HASH = "$argon2id$v=19$m=8,t=1,p=1$c29tZXNhbHQ$pRPeKUrX1MY"


def test_users_are_names_with_argon2id_hashes() -> None:
    assert parse_users(f"# comment\n\nagent-1:{HASH}\n") == {"agent-1": HASH}


@pytest.mark.parametrize(
    "line",
    ["agent-2:secret", "agent-2", f":{HASH}", f"agent-1:{HASH}", f"agent-2:{HASH.replace('2id', '2i')}", "a:$7$1$x$y"],
)
def test_a_user_without_such_a_hash_is_named_but_not_shown(line: str) -> None:
    with pytest.raises(ConfigurationError, match=r"^users, line 2, user ") as caught:
        parse_users(f"agent-1:{HASH}\n{line}\n", "users")
    assert "secret" not in str(caught.value)


def test_what_the_broker_takes_everybody_may_know() -> None:
    told: list[str] = []
    grants = grants_of("user b\ntopic read own/+", told)
    assert grants.may_subscribe(topics.BROKER_LIMITS)
    assert grants.may_receive(topics.BROKER_LIMITS)
    assert not grants.may_publish(topics.BROKER_LIMITS)
    assert not grants.may_receive(topics.BROKER_METER)
    assert told == [f"publish on {topics.BROKER_LIMITS}"]
