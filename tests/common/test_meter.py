"""Byte counters and MQTT packet sizes."""

import threading
from pathlib import Path

import pytest
from pydantic import ValidationError

from jouleswarm.common.meter.meter import (
    Direction,
    Meter,
    MeterRow,
    read_rows,
    read_work,
    received,
)
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.mqtt import packet_bytes, publish_packet_bytes
from jouleswarm.common.wire.topics import Link

WEIGHTS = topics.weights("r", "maml", 2, 3)  # jouleswarm/r/maml/sl/2/3/weights


@pytest.mark.parametrize(
    ("remaining", "size"),
    [  # the last and first lengths of 1, 2, 3 and 4 varint bytes (MQTT 3.1.1, table 2.4)
        (0, 2),
        (127, 129),
        (128, 131),
        (16_383, 16_386),
        (16_384, 16_388),
        (2_097_151, 2_097_155),
        (2_097_152, 2_097_157),
        (268_435_455, 268_435_460),
    ],
)
def test_packet_bytes_at_the_varint_steps(remaining: int, size: int) -> None:
    assert packet_bytes(remaining) == size


def test_publish_packet_of_paper_size_weights() -> None:
    assert len(WEIGHTS) == 10 + 2 + 5 + 3 + 2 + 2 + 8
    # 1 + 4 varint + 2 topic length + 32 topic + 2 packet id + payload
    assert publish_packet_bytes(WEIGHTS, 5_565_072, qos=1) == 5_565_113
    assert publish_packet_bytes(WEIGHTS, 5_565_072, qos=0) == 5_565_111


def test_a_topic_counts_as_utf8_bytes() -> None:
    assert publish_packet_bytes("é", 0, qos=0) == 6  # 1 + 1 + 2 + 2


def test_a_process_that_was_killed_goes_on_counting(tmp_path: Path) -> None:
    for _ in range(2):
        meter = Meter("client", tmp_path)
        meter.count("agent-3", WEIGHTS, "out", 100, 140)
        meter.count("agent-3", "not/metered", "out", 100, 140)
    meter.flush()
    (row,) = meter.rows()
    assert (row.client, row.messages, row.payload_bytes, row.packet_bytes) == ("agent-3", 2, 200, 280)
    assert read_rows("client", tmp_path) == [row]
    assert read_rows("client", tmp_path / "nowhere") == []


def test_counts_accumulate_per_client_topic_and_direction() -> None:
    meter = Meter("broker")
    meter.count("agent-3", WEIGHTS, "in", 100, 140)
    meter.count("agent-3", WEIGHTS, "in", 100, 140)
    meter.count("agent-4", WEIGHTS, "out", 100, 140)
    sent, delivered = meter.rows()
    assert sent == MeterRow(
        side="broker",
        arm="maml",
        phase="fl",
        topic=WEIGHTS,
        link=Link.SIDELINK,
        client="agent-3",
        direction="in",
        messages=2,
        payload_bytes=200,
        packet_bytes=280,
    )
    assert (delivered.client, delivered.direction, delivered.messages) == ("agent-4", "out", 1)


@pytest.mark.parametrize(
    "topic", [topics.BROKER_METER, topics.meter_report("r", "agent-1"), "other/r/maml/sl/2/3/weights", "$SYS/x"]
)
def test_reports_and_foreign_topics_are_not_metered(topic: str) -> None:
    meter = Meter("client")
    meter.count("agent-1", topic, "out", 10, 20)
    assert meter.rows() == []


def test_rows_come_in_a_stable_order() -> None:
    first, second = Meter("client"), Meter("client")
    keys = [("b", WEIGHTS), ("a", WEIGHTS), ("a", topics.meta_model("r", "maml"))]
    for client, topic in keys:
        first.count(client, topic, "in", 1, 2)
    for client, topic in reversed(keys):
        second.count(client, topic, "in", 1, 2)
    assert first.rows() == second.rows()


def test_nothing_is_lost_between_threads() -> None:
    meter = Meter("broker")

    def work() -> None:
        for _ in range(2000):
            meter.count("agent-1", WEIGHTS, "in", 3, 5)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    (row,) = meter.rows()
    assert (row.messages, row.payload_bytes, row.packet_bytes) == (8000, 24_000, 40_000)


def test_received_is_what_the_broker_delivers_or_the_clients_get() -> None:
    broker, client = Meter("broker"), Meter("client")
    sides: tuple[tuple[Meter, Direction, Direction], ...] = ((broker, "in", "out"), (client, "out", "in"))
    for meter, sent, got in sides:
        meter.count("agent-3", WEIGHTS, sent, 1, 2)
        meter.count("agent-4", WEIGHTS, got, 1, 2)
    rows = broker.rows() + client.rows()
    assert [(row.side, row.client) for row in received(rows, "broker")] == [("broker", "agent-4")]
    assert [(row.side, row.client) for row in received(rows, "client")] == [("client", "agent-4")]


def test_a_row_survives_json() -> None:
    meter = Meter("broker")
    meter.count("agent-3", WEIGHTS, "in", 100, 140)
    (row,) = meter.rows()
    assert MeterRow.model_validate_json(row.model_dump_json()) == row


def test_a_row_with_unknown_fields_is_refused() -> None:
    with pytest.raises(ValidationError):
        MeterRow.model_validate({"side": "broker", "joules": 3})


def test_work_is_counted_beside_the_bytes_and_outlives_the_process(tmp_path: Path) -> None:
    first = Meter("client", tmp_path)
    first.count("agent-1", WEIGHTS, "out", 10, 50)
    first.tally("fl", "maml", 2).gradients(3)
    first.tally("maml", "maml", 2).gradients(1, query=2)
    second = Meter("client", tmp_path)  # of the process that was started again after a kill
    second.tally("fl", "maml", 2).gradients()
    second.tally("fl", "maml", 2).motion()
    told = [(row.client, row.phase, row.arm, row.task, row.gradients, row.gradients_query, row.motions)
            for row in second.work("agent-1")]  # fmt: skip
    assert told == [("agent-1", "fl", "maml", 2, 4, 0, 1), ("agent-1", "maml", "maml", 2, 1, 2, 0)]
    assert read_work("agent-1", tmp_path) == second.work("agent-1")
    assert [row.topic for row in second.rows()] == [row.topic for row in read_rows("client", tmp_path)] == [WEIGHTS]
    assert second.totals("out")["sidelink"] == 10
