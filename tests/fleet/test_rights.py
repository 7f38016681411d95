"""The rights that keys are made with: every topic has a writer and a reader, and nobody has more than they need."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire import topics
from jouleswarm.fleet.rights import rights_file, rights_of

ROOT = Path(__file__).parents[2]
RUN, ARM = "+", "+"
TOY = load_scenario(ROOT / "scenarios" / "toy.toml")  # task 1: robots 1, 2; task 2: robots 3, 4
# Functions of common/wire/topics.py that make no topic.
READERS = {"run_name", "run_of", "arm_of", "task_of", "agent_of"}


def who(access: str, topic: str) -> set[str]:
    """Clients with exactly this right."""
    return {client for client, own in rights_of(TOY).items() if (access, topic) in own}


@pytest.mark.parametrize(
    ("topic", "writers", "readers"),
    [
        (topics.weights(RUN, ARM, 1, 2), {"agent-2"}, set()),
        (topics.weights(RUN, ARM, 1, "+"), set(), {"agent-1", "agent-2"}),
        (topics.weights_up(RUN, ARM, 2, 3), {"agent-3"}, set()),
        (topics.weights_up(RUN, ARM, "+", "+"), set(), {"datacenter"}),
        (topics.experience(RUN, ARM, 2, 4), {"agent-4"}, set()),
        (topics.experience(RUN, ARM, "+", "+"), set(), {"datacenter"}),
        (topics.episode(RUN, ARM, 1, 1), {"agent-1"}, set()),
        (topics.episode(RUN, ARM, 1, "+"), set(), {"agent-1", "agent-2"}),
        (topics.presence(RUN, 1, 1), {"agent-1"}, set()),
        (topics.presence(RUN, 2, "+"), set(), {"agent-3", "agent-4"}),
        (topics.presence(RUN, 0, 0), {"datacenter"}, {"agent-1", "agent-2", "agent-3", "agent-4"}),
        (topics.presence(RUN, "+", "+"), {"recorder"}, {"datacenter", "recorder"}),
        (topics.wait(RUN, "agent-2"), set(), {"agent-2"}),
        (topics.wait(RUN, "recorder"), set(), {"recorder"}),
        (topics.wait(RUN, "+"), {"agent-1", "agent-2", "agent-3", "agent-4", "datacenter", "recorder"}, set()),
        (topics.resend(RUN, ARM, 1, 2), set(), {"agent-2"}),
        (topics.resend(RUN, ARM, 1, "+"), {"agent-1", "agent-2"}, set()),
        (topics.resend(RUN, ARM, "+", "+"), {"datacenter"}, set()),
        (topics.collect_again(RUN, ARM, 1, 1), set(), {"agent-1"}),
        (topics.collect_again(RUN, ARM, "+", "+"), {"datacenter"}, set()),
        (topics.model_again(RUN, ARM, 1), {"agent-1", "agent-2"}, set()),
        (topics.model_again(RUN, ARM, "+"), set(), {"datacenter"}),
        (topics.meta_model(RUN, ARM), {"datacenter"}, {"agent-1", "agent-2", "agent-3", "agent-4"}),
        (topics.meta_model(RUN, ARM, 3), set(), {"agent-3"}),
        (topics.meta_model(RUN, ARM, "+"), {"datacenter"}, set()),
        (topics.cluster_model(RUN, ARM, 2), set(), {"agent-3", "agent-4"}),
        (topics.cluster_model(RUN, ARM, "+"), {"datacenter"}, set()),
        (topics.meta_round(RUN, ARM), {"datacenter"}, {"agent-1", "agent-2", "agent-3", "agent-4"}),
        (topics.meta_resend(RUN, ARM), {"agent-1", "agent-2", "agent-3", "agent-4"}, {"datacenter"}),
        (topics.telemetry(RUN, ARM, "agent-1"), {"agent-1"}, set()),
        (topics.telemetry(RUN, ARM, "datacenter"), {"datacenter"}, set()),
        (topics.telemetry(RUN, ARM, "+"), set(), {"recorder"}),
        (topics.learned(RUN, ARM, 1), {"agent-1"}, set()),
        (topics.learned(RUN, ARM, 2), {"agent-3"}, set()),
        (topics.learned(RUN, ARM, "+"), set(), {"recorder"}),
        (topics.snapshot(RUN, ARM, "+"), {"datacenter"}, {"recorder"}),
        (topics.meter_report(RUN, "agent-4"), {"agent-4"}, set()),
        (topics.meter_report(RUN, "datacenter"), {"datacenter"}, set()),
        (topics.meter_report(RUN, "+"), set(), {"recorder"}),
        (topics.claim(RUN, 1, 2), {"agent-2"}, {"agent-2"}),
        (topics.claim(RUN, 0, 0), {"datacenter"}, {"datacenter"}),
        (topics.recorder(RUN), {"recorder"}, {"agent-1", "agent-2", "agent-3", "agent-4", "datacenter"}),
        (topics.acknowledgement(RUN, "agent-1"), set(), {"agent-1"}),
        (topics.acknowledgement(RUN, "+"), {"recorder"}, set()),
        (topics.probe(RUN), {"recorder"}, {"recorder"}),
        (topics.scenario(RUN, "recorder"), {"recorder"}, {"agent-1", "agent-2", "agent-3", "agent-4", "datacenter"}),
        (
            topics.scenario(RUN, "all"),
            {"agent-1", "agent-2", "agent-3", "agent-4", "datacenter", "recorder"},
            {"agent-1", "agent-2", "agent-3", "agent-4", "datacenter"},
        ),
        (topics.acknowledgement(RUN, "recorder"), set(), {"recorder"}),
        (topics.BROKER_METER, set(), {"recorder"}),
        (topics.broker_answer("+"), set(), {"recorder"}),
        (topics.BROKER_LIMITS, set(), {"agent-1", "agent-2", "agent-3", "agent-4", "datacenter", "recorder"}),
        (topics.BROKER_METER_ASK, {"recorder"}, set()),
    ],
)
def test_who_may_write_and_who_may_read(topic: str, writers: set[str], readers: set[str]) -> None:
    assert (who("write", topic), who("read", topic)) == (writers, readers)


def test_every_kind_of_topic_is_in_the_rights() -> None:
    kinds = {
        name for name, each in inspect.getmembers(topics, inspect.isfunction) if each.__module__ == topics.__name__
    }
    source = inspect.getsource(__import__("jouleswarm.fleet.rights", fromlist=["rights"]))
    missing = {name for name in kinds - READERS if f"topics.{name}(" not in source}
    assert missing == set(), "a new topic needs a writer and a reader in jouleswarm/fleet/rights.py"


def test_a_client_for_each_robot_the_data_center_the_recorder_and_the_health_check() -> None:
    robots = ["agent-1", "agent-2", "agent-3", "agent-4"]
    assert list(rights_of(TOY)) == [*robots, "datacenter", "recorder", "health"]
    assert rights_of(TOY)["health"] == []


def test_the_file_has_a_block_for_each_client() -> None:
    text = rights_file({"a": [("read", "x/+"), ("write", "y")], "b": []})
    assert text.splitlines()[1:] == ["", "user a", "topic read x/+", "topic write y", "", "user b"]
    assert text.startswith("# ")


def test_going_on_without_the_missing_every_robot_may_hand_in_its_cluster_s_model() -> None:
    scenario = load_scenario(ROOT / "scenarios" / "toy.toml", ["federation.on_missing=proceed"])
    right = ("write", topics.learned(RUN, ARM, 1))
    assert {client for client, own in rights_of(scenario).items() if right in own} == {"agent-1", "agent-2"}
