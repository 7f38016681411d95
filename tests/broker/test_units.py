"""The broker's parts by themselves."""

from __future__ import annotations

import asyncio

from hypothesis import example, given
from hypothesis import strategies as st

from jouleswarm.broker.limits import Budget
from jouleswarm.broker.meter import BrokerMeter, by_link
from jouleswarm.broker.publication import Publication
from jouleswarm.broker.refusals import Refusals
from jouleswarm.common.bus.bus import matches
from jouleswarm.common.bus.paho_client import name_of, wire_id
from jouleswarm.common.meter.meter import read_rows
from jouleswarm.common.wire.messages import in_pieces
from jouleswarm.common.wire.topics import Link

WEIGHTS = "jouleswarm/run/maml/sl/1/1/weights"
LEVELS = st.lists(st.sampled_from(["a", "b", "", "jouleswarm"]), min_size=1, max_size=4)
FILTERS = st.lists(st.sampled_from(["a", "b", "", "+", "jouleswarm"]), min_size=1, max_size=4)


def test_budget_lets_waiters_in_first_come_first_served():
    async def scenario() -> list[bool]:
        budget = Budget(100)
        assert budget.try_take(60)
        assert not budget.try_take(50)
        first, second = budget.request(50), budget.request(10)
        assert not budget.try_take(10), "a newcomer may not overtake"
        budget.release(60)
        return [first.done(), second.done(), budget.used_bytes == 60]

    assert asyncio.run(scenario()) == [True, True, True]


def test_budget_takes_one_message_larger_than_itself():
    budget = Budget(100)
    assert budget.try_take(1000)
    assert not budget.try_take(1)


def test_budget_skips_a_waiter_that_has_gone():
    async def scenario() -> int:
        budget = Budget(100)
        budget.try_take(100)
        gone, here = budget.request(100), budget.request(40)
        gone.set_exception(ConnectionError("gone"))
        budget.release(100)
        assert here.done()
        assert isinstance(gone.exception(), ConnectionError)
        return budget.used_bytes

    assert asyncio.run(scenario()) == 40


def test_publication_gives_its_budget_back_once_with_its_last_holder():
    budget = Budget(100)
    budget.try_take(50)
    publication = Publication("a", memoryview(b"x"), 1, budget, 50)
    publication.hold()
    publication.drop()
    assert budget.used_bytes == 50
    publication.drop()
    assert budget.used_bytes == 0
    publication.hold()  # sent a second time
    publication.drop()
    assert budget.used_bytes == 0


def test_publish_header_bytes():
    publication = Publication("a/b", memoryview(bytes(200)), 1)
    # 2 + 3 + 200 = 205 = 0x4d + 1 * 128; with an identifier 207
    assert publication.header(0, 0, dup=False, retain=True) == b"\x31\xcd\x01\x00\x03a/b"
    assert publication.header(1, 258, dup=True, retain=False) == b"\x3a\xcf\x01\x00\x03a/b\x01\x02"
    assert publication.header(2, 258, dup=False, retain=False) == b"\x34\xcf\x01\x00\x03a/b\x01\x02"


def test_meter_books_under_the_plain_name_and_sums_by_link():
    meter = BrokerMeter()
    meter.count(wire_id("agent-3"), WEIGHTS, "in", 10, 48)
    meter.count(wire_id("agent-3"), WEIGHTS, "in", 10, 48)
    meter.count("mosq-A1", WEIGHTS, "out", 10, 48)
    meter.count("agent-3", "jouleswarm/meter/ask", "in", 5, 32)
    assert [(row.client, row.direction, row.messages, row.packet_bytes) for row in meter.rows()] == [
        ("agent-3", "in", 2, 96),
        ("mosq-A1", "out", 1, 48),
    ]
    assert by_link(meter.totals().items()) == {
        Link.SIDELINK: {
            "in": {"messages": 2, "payload_bytes": 20, "packet_bytes": 96},
            "out": {"messages": 1, "payload_bytes": 10, "packet_bytes": 48},
        }
    }


def test_a_broker_that_was_killed_goes_on_counting_rows_and_totals(tmp_path):
    killed = BrokerMeter(folder=tmp_path)
    killed.count(wire_id("agent-3"), WEIGHTS, "in", 10, 48)
    killed.count("agent-4", WEIGHTS, "out", 10, 48)
    killed.count("agent-4", WEIGHTS, "acked", 10, 48)
    meter = BrokerMeter(folder=tmp_path)
    meter.count(wire_id("agent-3"), WEIGHTS, "in", 10, 48)
    assert [(row.client, row.direction, row.messages, row.packet_bytes) for row in meter.rows()] == [
        ("agent-3", "in", 2, 96),
        ("agent-4", "acked", 1, 48),
        ("agent-4", "out", 1, 48),
    ]
    assert by_link(meter.totals().items()) == {
        Link.SIDELINK: {
            "in": {"messages": 2, "payload_bytes": 20, "packet_bytes": 96},
            "out": {"messages": 1, "payload_bytes": 10, "packet_bytes": 48},
        }
    }
    assert meter.rows() == read_rows("broker", tmp_path)


def test_a_broker_without_space_to_count_in_is_told_to_end(tmp_path):
    meter, failures = BrokerMeter(folder=tmp_path), []
    meter.on_failure = failures.append
    (tmp_path / "counters-0.bin").mkdir()  # in the way of the file
    meter.count("agent-1", "jouleswarm/r/maml/sl/1/1/weights", "in", 5, 52)
    (error,) = failures
    assert str(error).startswith(f"cannot write {tmp_path}/counters-0.bin: ")


def test_name_of_undoes_wire_id_and_leaves_other_ids_alone():
    assert wire_id("agent-3") != wire_id("agent-3")
    assert name_of(wire_id("agent-3")) == "agent-3"
    assert name_of(wire_id("a.b")) == "a.b"
    assert name_of("sensor.kitchen") == "sensor.kitchen"


@given(LEVELS, FILTERS, st.booleans())
@example(["a"], ["a"], True)
def test_amqtt_and_the_in_memory_bus_match_filters_alike(levels, filters, deep):
    from amqtt.broker import Broker

    topic, topic_filter = "/".join(levels), "/".join(filters) + ("/#" if deep else "")
    assert Broker._matches(object.__new__(Broker), topic, topic_filter) == matches(topic_filter, topic)


def test_the_newest_refusals_are_kept_each_once_with_how_often():
    refusals = Refusals()
    for number in range(22):
        refusals.add(f"refusal {number}")
    refusals.add("refusal 3")
    assert refusals.lines() == (*(f"refusal {number}" for number in (2, *range(4, 22))), "refusal 3 (2 times)")
    refusals.add("x" * 600)
    assert refusals.lines()[-1] == "x" * 497 + "..."


def test_rows_come_in_pieces_below_a_size():
    meter = BrokerMeter()
    for agent in range(5):
        meter.count(f"agent-{agent}", WEIGHTS, "in", 10, 48)
    row_bytes = len(meter.rows()[0].model_dump_json()) + 1  # and a comma
    pieces = list(in_pieces(meter.rows(), 2 * row_bytes))
    assert [[row.client for row in piece] for piece in pieces] == [
        ["agent-0", "agent-1"],
        ["agent-2", "agent-3"],
        ["agent-4"],
    ]
    assert list(in_pieces(meter.rows()[:1], 1)) == [[meter.rows()[0]]]
    assert list(in_pieces([], 100)) == [[]]


def counting(monkeypatch, kept_rows: int) -> BrokerMeter:
    """A meter with two rows of each of the runs a, b and c, of which b is counted again 10 minutes later."""
    monkeypatch.setattr("jouleswarm.broker.meter.KEPT_ROWS", kept_rows)
    meter = BrokerMeter()
    for run in "abc":
        meter.count("agent-1", f"jouleswarm/{run}/maml/sl/1/1/weights", "in", 10, 48)
        meter.count("agent-2", f"jouleswarm/{run}/maml/sl/1/1/weights", "out", 10, 48)
    meter.age(0.0)
    meter.count("agent-1", "jouleswarm/b/maml/sl/1/1/weights", "in", 10, 48)
    meter.age(600.0)
    return meter


def test_rows_of_runs_that_ended_long_ago_are_forgotten_where_there_are_many(monkeypatch):
    meter = counting(monkeypatch, kept_rows=4)
    totals = by_link(meter.totals().items())
    meter.age(3599.0)
    assert [len(meter.rows(run)) for run in "abc"] == [2, 2, 2], "an hour has not gone by"
    meter.age(3600.0)
    assert [len(meter.rows(run)) for run in "abc"] == [0, 2, 2], "now it has, and two rows fewer are enough"
    assert by_link(meter.totals().items()) == totals, "what was counted altogether stays"
    meter.count("agent-1", "jouleswarm/a/maml/sl/1/1/weights", "in", 10, 48)
    assert [row.messages for row in meter.rows("a")] == [1], "counted anew"


def test_no_rows_are_forgotten_of_what_still_goes_on_or_where_there_is_room(monkeypatch):
    meter = counting(monkeypatch, kept_rows=1)
    meter.age(4199.0)
    assert [len(meter.rows(run)) for run in "abc"] == [0, 2, 0]
    roomy = counting(monkeypatch, kept_rows=6)
    roomy.age(1e6)
    assert len(roomy.rows()) == 6


def test_forgotten_runs_do_not_come_back_with_the_next_broker(monkeypatch, tmp_path):
    monkeypatch.setattr("jouleswarm.broker.meter.KEPT_ROWS", 0)
    meter = BrokerMeter(folder=tmp_path)
    meter.count("agent-1", WEIGHTS, "in", 10, 48)
    meter.age(0.0)
    meter.age(3600.0)
    meter.age(7200.0)  # what is left of it is no run to forget
    assert meter.rows() == []
    assert BrokerMeter(folder=tmp_path).rows() == []
