"""What processes hand in to the recorder."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from jouleswarm.common.bus.bus import MemoryBus, MemoryHub
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.bus.reporter import MAX_REPORT_BYTES, PIECE_BYTES, MeterReport, Reporter, Telemetry
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Acknowledgement, Presence, decode_json, encode_json
from jouleswarm.common.wire.rows import RoundRow

DEADLINE_S, PATIENT_S, IMPATIENT_S = 20.0, 60.0, 0.01
WEIGHTS, HERE = topics.weights("r", "maml", 1, 4), topics.presence("r", 1, 3)
DONE = Presence(agent=3, stage=3, state="done")
LEARNED = topics.learned("r", "maml", 1)


def row(round_: int) -> RoundRow:
    return RoundRow(phase="fl", arm="maml", task=1, agent=3, round=round_, reward=51.5, seconds=0.25)


class Table:
    """Robot 3's line to the recorder, whose hands and ears are the test's."""

    def __init__(self, quiet_s: float = PATIENT_S, rows: Path | None = None) -> None:
        self.hub = MemoryHub()
        self.robot, self.others = self.hub.connect("agent-3"), self.hub.connect("others")
        self.recorder = self.hub.connect("recorder")
        self.listener = Listener(self.robot, quiet_s)
        self.reporter = Reporter(self.listener, "r", rows)

    def record(self) -> None:
        self.others.publish(topics.recorder("r"), encode_json(Presence(agent=0)), retain=True)
        self.listener.take_waiting()

    def acknowledge(self, topic: str, part: str = "") -> None:
        told = Acknowledgement(topic=topic, part=part)
        self.others.publish(topics.acknowledgement("r", "agent-3"), encode_json(told))

    def report(self) -> MeterReport:
        self.recorder.subscribe(topics.meter_report("r", "+"))
        self.reporter.hand_over([WEIGHTS], HERE, DONE, stay=False)
        self.reporter.leave(HERE)
        return decode_json(heard(self.recorder), MeterReport)


def heard(bus: MemoryBus) -> bytes:
    message = bus.receive(DEADLINE_S)
    assert message is not None, "nothing was said"
    return bytes(message.payload)


@pytest.fixture
def table() -> Table:
    return Table()


def test_a_row_travels_with_what_its_sender_had_received(table: Table) -> None:
    table.robot.subscribe(WEIGHTS)
    table.recorder.subscribe(topics.telemetry("r", "+", "+"))
    table.others.publish(WEIGHTS, b"12345")
    table.reporter.row(row(2))
    message = table.recorder.receive(0)
    assert message is not None
    assert message.topic == "jouleswarm/r/maml/tlm/agent-3/round"
    told = decode_json(message.payload, Telemetry)
    assert told.row == row(2)
    assert told.received == {"uplink": 0, "downlink": 0, "sidelink": 5, "control": 0}


def test_who_leaves_clears_its_presence_and_hands_in_counters_that_are_final(table: Table) -> None:
    table.robot.subscribe(WEIGHTS)
    table.robot.publish(HERE, encode_json(Presence(agent=3, stage=2)), retain=True)
    table.others.publish(WEIGHTS, b"12345")
    report = table.report()
    table.others.publish(WEIGHTS, b"too late")
    assert report.client == "agent-3"
    assert report.rows == table.robot.meter.rows()
    received = [each for each in report.rows if each.direction == "in"]
    assert [(each.topic, each.messages, each.payload_bytes) for each in received] == [(WEIGHTS, 1, 5)]

    late = table.hub.connect("late")
    late.subscribe(HERE)
    assert late.receive(0.001) is None  # an empty retained message removes the old one


def test_the_report_holds_all_rows_each_once_as_it_was_told_last(table: Table) -> None:
    again = row(1).model_copy(update={"reward": 7.0})
    for each in (row(1), row(2), again):
        table.reporter.row(each)
    assert table.report().rounds == [row(2), again]


def test_rows_of_a_robot_that_was_killed_are_in_the_report_of_its_next_life(tmp_path: Path) -> None:
    file = tmp_path / "rounds.jsonl"
    first = Table(rows=file)
    first.reporter.row(row(1))
    first.reporter.row(row(2))
    with file.open("ab") as torn:
        torn.write(b'{"phase":"fl","ar')
    second = Table(rows=file)
    second.reporter.row(row(3))
    assert second.report().rounds == [row(1), row(2), row(3)]
    assert Table(rows=file).report().rounds == [row(1), row(2), row(3)]


def many_rows(file: Path, rounds: int) -> None:
    """A robot's rows, as long as they get, without a round played."""
    line = row(1).model_copy(update={"reward": -28.685377497358648, "rmse_m": 1.4142135623730951}).model_dump_json()
    text = line.replace('"round":1,', '"round":%d,')
    with file.open("w", encoding="utf-8") as rows:
        rows.writelines(text % round_ + "\n" for round_ in range(1, rounds + 1))


def test_a_report_of_any_length_goes_in_pieces_of_bounded_size(tmp_path: Path) -> None:
    rounds = 60_001  # some 54,650 were too many for one message of 16 MiB
    many_rows(tmp_path / "rounds.jsonl", rounds)
    table = Table(rows=tmp_path / "rounds.jsonl")
    table.robot.meter.tally("fl", "maml", 1).gradients(20)
    table.recorder.subscribe(topics.meter_report("r", "+"))
    table.reporter.hand_over([WEIGHTS], HERE, DONE, stay=False)
    told: list[MeterReport] = []
    while not told or not told[-1].last:
        payload = heard(table.recorder)
        assert len(payload) <= PIECE_BYTES + 1000  # of the piece's own fields
        told.append(decode_json(payload, MeterReport, MAX_REPORT_BYTES))
    assert [piece.piece for piece in told] == list(range(1, len(told) + 1))
    assert len({piece.token for piece in told}) == 1
    assert [each.round for piece in told for each in piece.rounds] == list(range(1, rounds + 1))
    assert [each.gradients for piece in told for each in piece.work] == [20]


def test_a_piece_is_sent_until_that_very_piece_is_acknowledged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jouleswarm.common.bus.reporter.PIECE_BYTES", 100)  # a row each
    many_rows(tmp_path / "rounds.jsonl", 2)
    table = Table(IMPATIENT_S, tmp_path / "rounds.jsonl")
    table.record()
    topic = topics.meter_report("r", "agent-3")
    table.recorder.subscribe(topic)
    leaving = in_thread(lambda: table.reporter.hand_over([WEIGHTS], HERE, DONE, stay=False))
    first = decode_json(heard(table.recorder), MeterReport, MAX_REPORT_BYTES)
    table.acknowledge(topic, "another/1")
    assert decode_json(heard(table.recorder), MeterReport, MAX_REPORT_BYTES) == first
    rounds, pieces = set(), set()
    while leaving.is_alive() and (message := table.recorder.receive(DEADLINE_S)):
        piece = decode_json(message.payload, MeterReport, MAX_REPORT_BYTES)
        rounds |= {each.round for each in piece.rounds}
        pieces.add(piece.piece)
        table.acknowledge(topic, piece.part)
        if piece.last:
            leaving.join(DEADLINE_S)
    assert not leaving.is_alive()
    assert rounds == {1, 2}
    assert pieces == set(range(1, max(pieces) + 1))


def test_without_a_recorder_nobody_waits_for_one(table: Table) -> None:
    table.reporter.deliver(LEARNED, b"weights")


def in_thread(body: Callable[[], None]) -> threading.Thread:
    thread = threading.Thread(target=body, daemon=True)
    thread.start()
    return thread


def test_who_ends_leaves_its_presence_as_done_where_there_is_a_recorder(table: Table) -> None:
    table.record()
    table.recorder.subscribe(topics.meter_report("r", "+"))
    leaving = in_thread(lambda: table.reporter.hand_over([], HERE, DONE, stay=False))
    piece = decode_json(heard(table.recorder), MeterReport)
    table.acknowledge(topics.meter_report("r", "agent-3"), piece.part)
    leaving.join(DEADLINE_S)
    table.reporter.leave(HERE)
    late = table.hub.connect("late")
    late.subscribe(HERE)
    assert decode_json(heard(late), Presence) == DONE
    assert piece.rows == table.robot.meter.rows()  # nothing that is metered came after the report


def test_who_stays_hands_in_everything_again_to_a_recorder_that_comes_anew_and_goes_when_all_is_recorded(
    tmp_path: Path,
) -> None:
    table = Table(IMPATIENT_S, tmp_path / "robot" / "rounds.jsonl")
    report = topics.meter_report("r", "agent-3")
    table.recorder.subscribe(report, LEARNED)
    table.reporter.deliver(LEARNED, b"weights")  # before there is a recorder
    assert heard(table.recorder) == b"weights"

    def stay() -> None:
        table.reporter.hand_over([], HERE, DONE, stay=True)
        table.reporter.leave(HERE)

    def take_all() -> None:
        said = set()
        while not {LEARNED, report} <= said:
            message = table.recorder.receive(DEADLINE_S)
            assert message is not None
            said.add(message.topic)
            is_report = message.topic == report
            table.acknowledge(message.topic, decode_json(message.payload, MeterReport).part if is_report else "")

    def word(state: str) -> None:
        presence = encode_json(Presence.model_validate({"agent": 0, "state": state}))
        table.others.publish(topics.recorder("r"), presence, retain=True)

    table.record()
    staying = in_thread(stay)
    take_all()
    late = table.hub.connect("late")
    late.subscribe(HERE)
    assert decode_json(heard(late), Presence) == Presence(agent=3, stage=3)  # it is here
    for state in ("gone", "here"):
        word(state)
    take_all()
    assert staying.is_alive()
    word("done")
    staying.join(DEADLINE_S)
    assert not staying.is_alive()
    assert heard(late) == b""


def test_who_comes_back_knows_that_the_run_has_a_recorder(tmp_path: Path) -> None:
    rows = tmp_path / "robot" / "rounds.jsonl"
    first = Table(rows=rows)
    assert not first.reporter.has_recorder
    first.record()
    assert first.reporter.has_recorder
    assert Table(rows=rows).reporter.has_recorder


@pytest.mark.parametrize("ends", ["acknowledged", "the recorder dies", "the recorder leaves"])
def test_what_the_recorder_must_not_miss_is_sent_until_it_is_acknowledged_or_the_recorder_goes(ends: str) -> None:
    table = Table(IMPATIENT_S)
    table.record()
    table.recorder.subscribe(LEARNED)
    table.acknowledge(topics.learned("r", "maml", 2))  # of something else
    delivering = threading.Thread(target=table.reporter.deliver, args=(LEARNED, b"weights"), daemon=True)
    delivering.start()
    assert [heard(table.recorder) for _ in range(3)] == [b"weights"] * 3
    assert delivering.is_alive()
    if ends == "acknowledged":
        table.acknowledge(LEARNED)
    else:
        word = encode_json(Presence(agent=0, state="gone")) if ends == "the recorder dies" else b""
        table.others.publish(topics.recorder("r"), word, retain=True)
    delivering.join(DEADLINE_S)
    assert not delivering.is_alive()
