"""The broker's counters of one run: asked for until they come, counted from the run's beginning, or said to be none."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.bus.bus import MemoryHub
from jouleswarm.common.bus.reporter import MeterReport
from jouleswarm.common.errors import BrokerUnreachableError, RunError
from jouleswarm.common.meter.meter import Meter, MeterRow
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.broker_counters import BrokerLimits, CountersPiece, CountersRequest
from jouleswarm.common.wire.messages import encode_json
from jouleswarm.fleet.baseline import keep_baseline, kept_baseline, since
from jouleswarm.fleet.recorder import Recorder
from jouleswarm.runs.directory import RunDirectory

RUN, DEADLINE_S = "r", 20.0
WEIGHTS = topics.weights(RUN, "fl", 1, 1)
PRESENCE = topics.presence(RUN, 1, 1)
Answers = list[list[MeterRow] | None]


def counted(messages: int, client: str = "agent-2", topic: str = WEIGHTS, side: Any = "broker") -> list[MeterRow]:
    """Messages of 1000 bytes delivered to a client, or received by it."""
    meter = Meter(side)
    for _ in range(messages):
        meter.count(client, topic, "out" if side == "broker" else "in", 1000, 1040)
    return meter.rows()


class Deployment:
    """A recorder and a broker whose answers are the test's; it knows of itself only where there are any."""

    def __init__(self, path: Path) -> None:
        self.path, self.hub = path, MemoryHub()
        self.others, self.broker = self.hub.connect("others"), self.hub.connect("broker")
        self.asked = 0
        self.playing: threading.Thread | None = None

    def answer(self, answers: Answers, *, metering: bool = True, unmetered: int = 0) -> None:
        """Tell the limits, and to each question the next answer, a piece for each row; None: none."""
        self.broker.subscribe(topics.BROKER_METER_ASK)
        self.broker.publish(topics.BROKER_LIMITS, encode_json(BrokerLimits(message_bytes=1000)), retain=True)

        def play() -> None:
            for rows in answers:
                message = self.broker.receive(DEADLINE_S)
                if message is None or not len(message.payload):
                    return
                self.asked += 1
                question = CountersRequest.model_validate_json(bytes(message.payload))
                if rows is not None:
                    for piece in self.pieces(question, rows, metering, unmetered):
                        self.broker.publish(topics.broker_answer(question.asked), encode_json(piece))

        self.playing = threading.Thread(target=play, daemon=True)
        self.playing.start()

    @staticmethod
    def pieces(question: CountersRequest, rows: list[MeterRow], metering: bool, unmetered: int) -> list[CountersPiece]:
        count = max(1, len(rows))
        told = {
            "asked": question.asked,
            "run": question.run,
            "pieces": count,
            "metering": metering,
            "unmetered": unmetered,
        }
        return [
            CountersPiece.model_validate({**told, "piece": number, "rows": rows[number - 1 : number]})
            for number in range(count, 0, -1)
        ]

    def recorder(self, directory: str = "run", state: Path | None = None, **settings: Any) -> Recorder:
        bus = {"connect_timeout_s": 0.3, "resend_after_s": DEADLINE_S} | settings.pop("bus", {})
        scenario = deployment_scenario(bus, settings)
        return Recorder(self.hub.connect("recorder"), scenario, RUN, RunDirectory(self.path / directory), state)

    def summary(self, directory: str = "run") -> dict[str, Any]:
        found: dict[str, Any] = json.loads((self.path / directory / "summary.json").read_text())
        return found

    def delivered(self, directory: str = "run") -> list[tuple[str, int, int]]:
        lines = (self.path / directory / "meter.jsonl").read_text().splitlines()
        rows = [MeterRow.model_validate_json(line) for line in lines]
        return [(row.client, row.messages, row.payload_bytes) for row in rows if row.side == "broker"]


def deployment_scenario(bus: dict[str, Any], federation: dict[str, Any]) -> Scenario:
    return scenario_from(
        {
            "name": "t", "seed": 4, "methods": ["fl"], "world": {"rows": 3, "cols": 2}, "meta": {"training_tasks": [1]},
            "bus": bus, "federation": federation, "tasks": [{"id": 1, "map": "E . \n * . \n X ."}],
        },
        "test",
    )  # fmt: skip


@pytest.fixture
def deployment(tmp_path: Path) -> Iterator[Deployment]:
    made = Deployment(tmp_path)
    yield made
    if made.playing is not None:
        made.others.publish(topics.BROKER_METER_ASK, b"")
        made.playing.join(DEADLINE_S)
        assert not made.playing.is_alive()


def test_the_answer_is_put_together_from_pieces_in_any_order(deployment: Deployment) -> None:
    deployment.answer([[], [*counted(2), *counted(1, topic=PRESENCE), *counted(3, "agent-1")]])
    deployment.recorder().close("complete")
    assert deployment.delivered() == [("agent-2", 2, 2000), ("agent-2", 1, 1000), ("agent-1", 3, 3000)]
    assert deployment.summary()["metered_by"] == "broker"
    assert deployment.summary()["counters"] == "the broker's counters, from the run's beginning"


def test_a_broker_that_does_not_answer_at_once_is_asked_again(deployment: Deployment) -> None:
    deployment.answer([None, [], None, None, counted(2)])
    deployment.recorder(bus={"resend_after_s": 0.02}).close("complete")
    assert deployment.asked == 5
    assert deployment.delivered() == [("agent-2", 2, 2000)]


def test_a_broker_that_never_answers_ends_the_run_by_name_and_all_is_written(deployment: Deployment) -> None:
    deployment.answer([[]])
    recorder = deployment.recorder(give_up_after_s=0.05)
    with pytest.raises(RunError, match=r"the broker has not answered .* for its counters for 0\.05 s"):
        recorder.close("complete")
    assert deployment.summary()["status"] == "failed"
    assert deployment.summary()["counters"].startswith("the clients' own counters, for the broker has not answered")


@pytest.mark.parametrize(("status", "written"), [("complete", "failed"), ("interrupted", "interrupted")])
def test_a_broker_that_is_gone_at_the_end_leaves_a_summary_from_the_clients_counters(
    deployment: Deployment, monkeypatch: pytest.MonkeyPatch, status: Any, written: str
) -> None:
    recorder = deployment.recorder()

    def gone(*filters: str, qos: int = 1) -> None:
        raise BrokerUnreachableError("no MQTT broker for 0.3 s")

    monkeypatch.setattr(recorder._bus, "subscribe", gone)
    with pytest.raises(BrokerUnreachableError):
        recorder.close(status)
    assert deployment.summary()["status"] == written
    assert deployment.summary()["counters"] == "the clients' own counters, for no MQTT broker for 0.3 s"


def test_the_summary_says_why_the_clients_own_counters_feed_the_bill(deployment: Deployment) -> None:
    deployment.recorder("foreign").close("complete")
    told = "the clients' own counters, for the broker is not JouleSwarm's and counts nothing for us"
    assert deployment.summary("foreign")["counters"] == told
    deployment.answer([[], []], metering=False)
    deployment.recorder("told to").close("complete")
    told = "the clients' own counters, for the broker was told to count nothing"
    assert deployment.summary("told to")["counters"] == told


def test_what_the_broker_had_counted_before_is_not_billed_again(deployment: Deployment) -> None:
    before = [*counted(2), *counted(1, "recorder", PRESENCE)]
    deployment.answer([before, [*counted(5), *counted(1, "recorder", PRESENCE)]])
    deployment.recorder().close("complete")
    assert deployment.delivered() == [("agent-2", 3, 3000)]


def test_a_run_that_is_gone_on_with_keeps_its_own_beginning(deployment: Deployment, tmp_path: Path) -> None:
    deployment.answer([counted(2), counted(5)])
    deployment.recorder("killed", tmp_path / "state")  # and is never closed
    deployment.recorder("resumed", tmp_path / "state").close("complete")
    assert deployment.asked == 2
    assert deployment.delivered("resumed") == [("agent-2", 3, 3000)]


@pytest.mark.parametrize(
    "damage",
    [lambda text: text[:-5], lambda text: text.replace("1000", "1001"), lambda text: "[]", lambda text: '{"rows": []}'],
)
def test_a_damaged_beginning_is_refused(tmp_path: Path, damage: Callable[[str], str]) -> None:
    file = tmp_path / "state" / "baseline.json"
    keep_baseline(file, counted(1))
    assert kept_baseline(file) == counted(1)
    file.write_text(damage(file.read_text()))
    with pytest.raises(RunError, match=r"baseline\.json: damaged"):
        kept_baseline(file)


def test_a_broker_that_lost_its_counters_in_mid_run_is_noticed(deployment: Deployment) -> None:
    deployment.answer([counted(4), counted(1)])
    deployment.recorder().close("complete")
    assert deployment.delivered() == [("agent-2", 1, 1000)]  # all of it since then, so of this run
    assert "are gone, as of a broker that was started again" in deployment.summary()["counters"]


def test_messages_that_the_broker_had_no_room_to_count_are_told(deployment: Deployment) -> None:
    deployment.answer([[], counted(1)], unmetered=7)
    deployment.recorder().close("complete")
    assert "no room to count 7 messages" in deployment.summary()["counters"]


@pytest.mark.parametrize(("received", "billed"), [(3, 3), (1, 1), (4, 1)])
def test_who_has_counted_since_before_the_recorder_came_is_billed_from_its_own_beginning(
    deployment: Deployment, received: int, billed: int
) -> None:
    """The broker had counted 2 deliveries to robot 2 when the recorder came, and 3 at the end."""
    deployment.answer(
        [[*counted(2), *counted(5, "recorder", PRESENCE)], [*counted(3), *counted(6, "recorder", PRESENCE)]]
    )
    recorder = deployment.recorder()
    report = MeterReport(client="agent-2", rows=counted(received, side="client"), rounds=[])
    deployment.others.publish(topics.meter_report(RUN, "agent-2"), encode_json(report))
    recorder.pump(0.05)
    recorder.close("complete")
    assert deployment.delivered() == [("agent-2", billed, 1000 * billed), ("recorder", 1, 1000)]
    summary = deployment.summary()
    # 4 received of 3 fits neither way: that is said
    assert summary["counters_fit"] == (received != 4)
    assert ("from its own beginning" in summary["counters"]) == (received == 3)


COUNTS = st.dictionaries(
    st.tuples(st.sampled_from(["agent-1", "agent-2"]), st.sampled_from([WEIGHTS, PRESENCE])), st.integers(1, 5)
)


@given(before=COUNTS, during=COUNTS)
def test_what_came_since_is_what_is_more(before: dict[Any, int], during: dict[Any, int]) -> None:
    def rows(counts: dict[Any, int]) -> list[MeterRow]:
        return [row for (client, topic), messages in sorted(counts.items()) for row in counted(messages, client, topic)]

    both = {key: before.get(key, 0) + during.get(key, 0) for key in {**before, **during}}
    assert since(rows(both), rows(before)) == (rows(during), False)
