"""Rules from topics to links."""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire.rules import Rule, find, read_rules

LINKS = """\
# the first that matches counts
"fed/+round/+client/up" = { link = "uplink", phase = "fl" }
"fed/+round/#rest" = { link = "downlink" }
"peers/+/w" = [{ link = "uplink", receiver = "server*" }, { link = "sidelink", phase = "ml" }]
'state/#' = { link = "control", sender = "*-pi" }
"""


def rules_of(folder: Path, text: str) -> list[Rule]:
    path = folder / "links.toml"
    path.write_text(text)
    return read_rules(path)


def test_the_first_rule_that_matches_counts_and_named_levels_are_labels(tmp_path: Path) -> None:
    rules = rules_of(tmp_path, LINKS)

    def told(topic: str, sender: str | None = None, receiver: str | None = None) -> tuple[str, dict[str, str]] | None:
        rule = find(rules, topic, sender, receiver)
        return rule and (rule.priced.link.value, rule.labels(tuple(topic.split("/"))))

    assert told("fed/7/c1/up") == ("uplink", {"round": "7", "client": "c1"})
    assert told("fed/7/c1/down") == ("downlink", {"round": "7", "rest": "c1/down"})
    assert told("fed/7") == ("downlink", {"round": "7", "rest": ""})  # as in MQTT, # matches the level above it too
    assert told("fed") is None
    assert told("other/7/c1/up") is None


def test_who_sends_and_who_receives_decides_where_it_is_known(tmp_path: Path) -> None:
    rules = rules_of(tmp_path, LINKS)
    assert find(rules, "peers/3/w", receiver="server-1") == rules[2]
    assert find(rules, "peers/3/w", receiver="robot-1") == rules[3]
    assert find(rules, "peers/3/w", sender="server-1") == rules[3]  # nobody is known to receive it yet
    assert find(rules, "state/x", sender="left-pi") == rules[4]
    assert find(rules, "state/x", sender="left-pi-2") is None
    assert find(rules, "state/x", receiver="left-pi") is None


def test_wildcards_do_not_match_topics_of_the_broker(tmp_path: Path) -> None:
    rules = rules_of(tmp_path, '"#" = { link = "control" }')
    assert find(rules, "$SYS/broker/uptime") is None
    assert find(rules, "a") == rules[0]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('\n"a/b+" = { link = "uplink" }', "line 2: 'a/b+' is no topic filter, expected + or +name alone in a level"),
        ('"a/#rest/b" = { link = "uplink" }', "line 1: 'a/#rest/b' is no topic filter"),
        ('"+x/+x" = { link = "uplink" }', "line 1: '+x/+x' names two levels x"),
        ('"a" = { link = "uplnk" }', "line 1: 'a': link: Input should be 'uplink', 'downlink'"),
        ('"a" = { link = "uplink", recever = "x" }', "line 1: 'a': recever: Extra inputs"),
        ('\n\n"a" = "uplink"', "line 3: 'a': "),
        ('"a" = { link = "uplink", sender = "x", receiver = "y" }', "line 1: sender and receiver"),
        ('"a/#" = { link = "uplink" }\n"a/+x/b" = { link = "sidelink" }', "line 2: 'a/+x/b' can never be reached"),
        (
            '"a" = [{ link = "uplink", sender = "s*" }, { link = "sidelink", sender = "s-*-1" }]',
            "line 1: 'a' can never be reached, for 'a' in line 1",
        ),
        ('"a" = 1\n"a" = 2\n', "at line 2"),
        ("# nothing", "0 of them, expected from 1 to 200"),
    ],
)
def test_a_rule_that_can_not_be_is_one_line_with_its_number(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        rules_of(tmp_path, text)
    assert told in str(error.value)
    assert "\n" not in str(error.value)


def test_a_narrower_rule_before_a_wider_one_hides_nothing(tmp_path: Path) -> None:
    lines = (
        '"a/b" = { link = "uplink" }',
        '"a/+" = { link = "sidelink", sender = "x*" }',
        '"a/#" = { link = "control" }',
    )
    assert [rule.line for rule in rules_of(tmp_path, "\n".join(lines))] == [1, 2, 3]
