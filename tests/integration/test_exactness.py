"""Bytes are conserved to the byte, and results do not depend on the way they were come by."""

from typing import Any

import pytest

from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.simulation import run_in_memory
from tests.integration.conftest import on_the_wire

Count = tuple[int, int, int]
ROUNDS = 3  # of the small run, see conftest.py


def counts(run: Any, side: str, direction: str) -> dict[tuple[str, str], Count]:
    """(topic, client) -> messages, payload bytes, packet bytes."""
    return {
        (row["topic"], row["client"]): (row["messages"], row["payload_bytes"], row["packet_bytes"])
        for row in run.lines("meter.jsonl")
        if (row["side"], row["direction"]) == (side, direction)
    }


@pytest.fixture(scope="module")
def qos_0_run(run_toy: Any, small: Any):
    return run_toy("qos0", *small, "bus.qos=0")


@pytest.fixture(scope="module")
def codecs_run(run_toy: Any, small: Any):
    changes = ("federation.codec=topk", "meta.experience_codec=png", "methods=['maml', 'fedavg', 'centralized']")
    return run_toy("codecs", *small, *changes)


@pytest.fixture(params=["toy_run", "small_run", "qos_0_run", "methods_run", "codecs_run"])
def any_run(request: pytest.FixtureRequest):
    return request.getfixturevalue(request.param)


def test_what_clients_sent_is_what_the_broker_received_topic_by_topic(any_run: Any) -> None:
    sent = counts(any_run, "client", "out")
    assert sent
    assert counts(any_run, "broker", "in") == sent


def test_what_the_broker_delivered_is_what_clients_received_topic_by_topic(any_run: Any) -> None:
    delivered = counts(any_run, "broker", "out")
    assert delivered
    assert counts(any_run, "client", "in") == delivered


def test_what_was_delivered_at_qos_1_was_acknowledged_topic_by_topic(toy_run: Any, small_run: Any) -> None:
    for run in (toy_run, small_run):
        acknowledged = counts(run, "broker", "acked")
        assert acknowledged
        assert acknowledged == counts(run, "broker", "out")


def test_at_qos_0_only_control_is_acknowledged(qos_0_run: Any) -> None:
    delivered, acknowledged = counts(qos_0_run, "broker", "out"), counts(qos_0_run, "broker", "acked")
    assert {topic.split("/")[3] for topic, _ in acknowledged} == {"ctl", "tlm"}
    assert all(count == delivered[key] for key, count in acknowledged.items())


def test_where_nothing_fails_nothing_is_sent_twice(any_run: Any) -> None:
    assert counts(any_run, "client", "repeated") == {}


def test_qos_costs_two_bytes_a_message_each_way_and_changes_nothing_else(small_run: Any, qos_0_run: Any) -> None:
    assert qos_0_run.figures == small_run.figures
    assert qos_0_run.weights == small_run.weights
    for direction in ("in", "out"):
        at_1, at_0 = counts(small_run, "broker", direction), counts(qos_0_run, "broker", direction)
        priced = [key for key in at_1 if key[0].split("/")[3] in ("ul", "dl", "sl")]
        assert len(priced) > 0
        for topic, client in priced:
            messages, payload, packet = at_1[topic, client]
            other = topic.replace("/small/", "/qos0/")
            # the run's name, `qos0`, is a byte shorter; a packet identifier takes two
            assert at_0[other, client] == (messages, payload, packet - 3 * messages)


def test_sidelink_bytes_are_rounds_x_links_x_payload(small_run: Any) -> None:
    payload = len(on_the_wire(small_run.weights["maml-task1.safetensors"]))
    topic = len("jouleswarm/small/maml/sl/1/1/weights")
    packet = 1 + 3 + 2 + topic + 2 + payload  # 16 384 <= remaining length < 2 097 152: three bytes
    assert 16_384 < payload < 2_000_000
    for arm, longer in (("maml", 0), ("fl", len("fl") - len("maml"))):
        messages = 2 * ROUNDS * 2  # clusters x rounds x directed links
        expected = {"messages": messages, "payload": messages * payload, "packet": messages * (packet + longer)}
        assert small_run.summary["arms"][arm]["bytes"]["sidelink"] == expected


@pytest.mark.parametrize("name", ["small_run", "toy_run", "methods_run", "codecs_run"])
def test_robots_as_threads_over_the_in_memory_bus_come_to_the_same_bits(
    name: str, request: pytest.FixtureRequest
) -> None:
    run = request.getfixturevalue(name)
    outcome = run_in_memory(scenario_from(run.manifest["scenario"], "manifest"))
    assert [row.model_dump(mode="json", exclude={"seconds"}) for row in outcome.rows] == run.figures
    kept = {f"{arm}-task{task}.safetensors": payload for (arm, task), payload in outcome.learned.items()}
    kept |= {f"{arm}-meta-t{t0:04d}.safetensors": payload for (arm, t0), payload in outcome.snapshots.items()}
    assert kept == run.weights


def test_the_in_memory_bus_counts_the_same_bytes(small_run: Any) -> None:
    outcome = run_in_memory(scenario_from(small_run.manifest["scenario"], "manifest"), run="small")
    priced = {
        (row.topic, row.client, row.direction): (row.messages, row.payload_bytes, row.packet_bytes)
        for row in outcome.hub.meter.rows()
        if row.link in ("uplink", "downlink", "sidelink")
    }
    real = {
        (topic, client, direction): count
        for direction in ("in", "out")
        for (topic, client), count in counts(small_run, "broker", direction).items()
        if topic.split("/")[3] in ("ul", "dl", "sl")
    }
    assert priced == real
