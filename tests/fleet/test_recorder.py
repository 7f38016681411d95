"""The recorder: from what is said on the bus to the run directory, over the in-memory bus."""

import json
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jouleswarm.common.bus.bus import MemoryBus, MemoryHub
from jouleswarm.common.bus.reporter import MeterReport, Telemetry
from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Acknowledgement, ModelHeader, Presence, Wait, decode_json, encode_json
from jouleswarm.common.wire.models import encode_model
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.fleet.recorder import Recorder
from jouleswarm.runs.directory import MANIFEST, RunDirectory

RUN = "r"
DEADLINE_S = 20.0
CLIENTS = ["agent-1", "agent-2", "datacenter"]


@pytest.fixture
def scenario() -> Scenario:
    return scenario_from(
        {
            "name": "t", "seed": 4, "world": {"rows": 3, "cols": 2}, "meta": {"t0": 1, "training_tasks": [1]},
            "bus": {"connect_timeout_s": 0.3}, "tasks": [{"id": 1, "map": "E . \n * . \n X ."}],
        },
        "test",
    )  # fmt: skip


def made(agent: int, round_: int, **fields: Any) -> RoundRow:
    return RoundRow.model_validate(
        {"phase": "fl", "arm": "maml", "task": 1, "agent": agent, "round": round_, "seconds": 0.5} | fields
    )


class Table:
    def __init__(self, scenario: Scenario, path: Path) -> None:
        self.hub = MemoryHub()
        self.path = path
        self.bus = self.hub.connect("recorder")
        self.recorder = Recorder(self.bus, scenario, RUN, RunDirectory(path))
        self.others = self.hub.connect("others")
        self.ears: dict[str, MemoryBus] = {}

    def row(self, agent: int, round_: int, client: str = "", **fields: Any) -> None:
        row = made(agent, round_, **fields)
        received = {"uplink": 0, "downlink": 10, "sidelink": 100 * round_, "control": 1}
        telemetry = Telemetry(row=row, received=received)
        self.others.publish(topics.telemetry(RUN, "maml", client or f"agent-{agent}"), encode_json(telemetry))

    def report(self, client: str, meter: Meter | None = None, rounds: Sequence[RoundRow] = (), **piece: Any) -> None:
        rows, work = (meter.rows(), meter.work(client)) if meter else ([], [])
        report = MeterReport(client=client, rows=rows, work=work, rounds=list(rounds), **piece)
        self.others.publish(topics.meter_report(RUN, client), encode_json(report))

    def acknowledged(self, client: str) -> list[str]:
        """The topics that the recorder has acknowledged to a client since it was first asked."""
        if client not in self.ears:
            self.ears[client] = self.hub.connect(f"ears of {client}")
            self.ears[client].subscribe(topics.acknowledgement(RUN, client))
        self.pump()
        said = []
        while message := self.ears[client].receive(0):
            said.append(decode_json(message.payload, Acknowledgement).topic)
        return said

    def present(self, agent: int, state: str) -> None:
        presence = Presence.model_validate({"agent": agent, "state": state})
        self.others.publish(topics.presence(RUN, 1 if agent else 0, agent), encode_json(presence), retain=True)

    def pump(self) -> None:
        self.recorder.pump(0.05)
        while not self.bus._inbox.empty():  # a busy machine takes its time
            self.recorder.pump(0.05)

    def pump_all(self, refused: int) -> None:
        """Until so many messages have been refused."""
        for _ in range(100):
            if self.recorder.refused >= refused:
                return
            self.pump()

    def json(self, name: str) -> Any:
        return json.loads((self.path / name).read_text())

    def lines(self, name: str) -> list[Any]:
        return [json.loads(line) for line in (self.path / name).read_text().splitlines()]


@pytest.fixture
def table(scenario: Scenario, tmp_path: Path) -> Table:
    return Table(scenario, tmp_path / "run")


def test_it_waits_for_the_counters_of_every_process(table: Table) -> None:
    assert sorted(table.recorder.waiting_for) == CLIENTS
    for client in CLIENTS:
        table.report(client)
    table.pump()
    assert table.recorder.waiting_for == []


def test_an_arm_without_meta_learning_has_no_data_center_to_wait_for(scenario: Scenario, tmp_path: Path) -> None:
    plain = scenario_from({**scenario.model_dump(mode="json"), "methods": ["fl"]}, "test")
    table = Table(plain, tmp_path / "run")
    assert sorted(table.recorder.waiting_for) == ["agent-1", "agent-2"]


def test_rows_are_written_as_they_come_and_the_newest_is_known(table: Table) -> None:
    for round_ in (1, 2):
        for agent in (2, 1):
            table.row(agent, round_)
    table.pump()
    assert [(row["agent"], row["round"]) for row in table.lines("rounds.jsonl")] == [(2, 1), (1, 1), (2, 2), (1, 2)]
    assert table.recorder.newest["maml", 1, 2].round == 2
    assert [row.agent for row in table.recorder.rows] == [2, 1, 2, 1]


def test_rows_lost_while_the_run_goes_on_come_back_with_the_reports(table: Table) -> None:
    for round_ in (1, 2, 3):
        for agent in (1, 2):
            table.row(agent, round_)
    table.pump()
    (table.path / "rounds.jsonl").unlink()
    table.row(1, 4)
    for agent, rounds in ((1, 4), (2, 3)):
        table.report(f"agent-{agent}", rounds=[made(agent, round_) for round_ in range(1, rounds + 1)])
    table.pump()
    table.recorder.close("complete")
    told = [(row["agent"], row["round"]) for row in table.lines("rounds.jsonl")]
    assert told == [(1, 1), (1, 2), (1, 3), (1, 4), (2, 1), (2, 2), (2, 3)]
    assert table.json("summary.json")["status"] == "complete"


def test_a_run_whose_rows_are_lost_for_good_is_not_complete(table: Table) -> None:
    for agent in (1, 2):
        table.report(f"agent-{agent}", rounds=[made(agent, 1), made(agent, 2)])
    table.pump()
    file = table.path / "rounds.jsonl"
    file.write_bytes(b"".join(file.read_bytes().splitlines(keepends=True)[:3]))
    with pytest.raises(RunError, match=r"rounds\.jsonl: 2 rows were lost, robot 2 in maml; the run is not complete"):
        table.recorder.close("complete")
    assert table.json("summary.json")["status"] == "failed"


def test_a_row_that_is_told_twice_is_written_once(table: Table) -> None:
    for reward in (1.0, 2.0):  # by a robot that was killed in between, and has done the round again
        table.row(1, 1, reward=reward)
    table.row(1, 2)
    table.pump()
    assert [(row["round"], row["reward"]) for row in table.lines("rounds.jsonl")] == [(1, 1.0), (2, None)]


def test_rows_that_never_came_are_in_the_final_report(table: Table) -> None:
    table.row(1, 2)
    table.report("agent-1", rounds=[made(1, 1), made(1, 2), made(1, 3)])
    table.pump()
    assert [row["round"] for row in table.lines("rounds.jsonl")] == [2, 1, 3]
    table.recorder.close("complete")
    assert [row["round"] for row in table.lines("rounds.jsonl")] == [1, 2, 3]


def test_a_report_in_pieces_counts_once_all_have_come_each_once(table: Table) -> None:
    first, second = client_counters("agent-1", WEIGHTS, "out", 1000), client_counters("agent-1", WEIGHTS, "in", 70)
    table.report("agent-1", first, [made(1, 1)], token="killed", piece=1, last=False)
    table.report("agent-1", first, [made(1, 1)], token="a", piece=1, last=False)
    table.report("agent-1", first, [made(1, 1)], token="a", piece=1, last=False)  # its acknowledgement was lost
    table.pump()
    assert "agent-1" in table.recorder.waiting_for
    table.report("agent-1", second, [made(1, 2)], token="a", piece=2)
    table.pump()
    assert "agent-1" not in table.recorder.waiting_for
    table.recorder.close("interrupted")
    rows = [row for row in table.lines("meter.jsonl") if row["client"] == "agent-1"]
    assert [(row["direction"], row["messages"], row["payload_bytes"]) for row in rows] == [
        ("out", 1, 1000),
        ("in", 1, 70),
    ]
    assert [row["round"] for row in table.lines("rounds.jsonl")] == [1, 2]


def test_each_piece_of_a_report_is_acknowledged_by_its_name(table: Table) -> None:
    ears = table.hub.connect("ears")
    ears.subscribe(topics.acknowledgement(RUN, "agent-1"))
    table.report("agent-1", token="a", piece=1, last=False)
    table.report("agent-1", token="a", piece=2)
    table.pump()
    told = [decode_json(message.payload, Acknowledgement).part for _ in range(2) if (message := ears.receive(0))]
    assert told == ["a/1", "a/2"]


def test_a_report_of_more_counters_than_a_process_can_have_ends_the_run(
    table: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("jouleswarm.fleet.handed_in.MAX_ROWS", 1)
    table.report("agent-1", client_counters("agent-1", WEIGHTS, "out", 1000), last=False)
    table.report("agent-1", client_counters("agent-1", WEIGHTS, "in", 1000), piece=2)
    with pytest.raises(RunError, match="the report of agent-1 has over 1 counters"):
        table.pump()


def test_a_report_with_anothers_counters_or_rows_is_refused(table: Table) -> None:
    table.report("agent-1", client_counters("agent-2", WEIGHTS, "out", 1000))
    table.report("agent-1", rounds=[made(2, 1)])
    table.pump_all(refused=2)
    assert table.recorder.refused == 2
    assert "agent-1" in table.recorder.waiting_for


def test_what_must_not_be_missed_is_acknowledged_once_it_is_written_down(table: Table) -> None:
    assert [table.acknowledged(client) for client in CLIENTS] == [[], [], []]
    learned = encode_model({"w": np.ones(2, np.float32)}, ModelHeader(task=1, agent=1, round=1))
    meta = encode_model({"w": np.ones(2, np.float32)}, ModelHeader(task=0, agent=0, round=1))
    table.others.publish(topics.learned(RUN, "fl", 1), learned)
    table.others.publish(topics.snapshot(RUN, "maml", 1), meta)
    table.report("agent-2")
    # The cluster's first robot hands it in, or another where that one is gone.
    assert table.acknowledged("agent-1") == [topics.learned(RUN, "fl", 1)]
    assert table.acknowledged("agent-2") == [topics.learned(RUN, "fl", 1), topics.meter_report(RUN, "agent-2")]
    assert table.acknowledged("datacenter") == [topics.snapshot(RUN, "maml", 1)]
    table.report("agent-2")  # the acknowledgement was lost
    assert table.acknowledged("agent-2") == [topics.meter_report(RUN, "agent-2")]


def test_what_cannot_be_read_is_not_acknowledged(table: Table) -> None:
    assert table.acknowledged("agent-1") == []
    table.others.publish(topics.learned(RUN, "fl", 1), b"garbage")
    table.others.publish(topics.meter_report(RUN, "agent-1"), b"garbage")
    assert table.acknowledged("agent-1") == []


def test_a_recorder_says_that_it_is_there_and_when_it_is_not_any_more(table: Table) -> None:
    early = table.hub.connect("early")
    early.subscribe(topics.recorder(RUN))
    message = early.receive(0)
    assert message is not None
    assert decode_json(message.payload, Presence).state == "here"
    table.recorder.close("complete")
    late = table.hub.connect("late")
    late.subscribe(topics.recorder(RUN))
    assert late.receive(0.001) is None


def test_bytes_so_far_are_the_newest_of_each_client(table: Table) -> None:
    table.row(1, 1)
    table.row(1, 3)
    table.row(2, 2)
    table.pump()
    assert table.recorder.received_bytes == {"uplink": 0, "downlink": 20, "sidelink": 300 + 200, "control": 2}


def test_models_are_kept_under_their_names(table: Table) -> None:
    learned, meta = (
        encode_model({"w": np.ones(2, np.float32)}, ModelHeader(task=task, agent=task, round=42)) for task in (1, 0)
    )
    table.others.publish(topics.learned(RUN, "fl", 1), learned)
    table.others.publish(topics.snapshot(RUN, "maml", 1), meta)
    # what cannot be read afterwards does not take the place of what can
    table.others.publish(topics.learned(RUN, "fl", 1), learned[:-1])
    table.others.publish(topics.snapshot(RUN, "maml", 1), b"garbage")
    table.pump_all(refused=2)
    kept = {path.name: path.read_bytes() for path in (table.path / "weights").iterdir()}
    assert kept == {"fl-task1.safetensors": learned, "maml-meta-t0001.safetensors": meta}


@pytest.mark.parametrize(
    "topic",
    [
        topics.telemetry(RUN, "maml", "agent-1"),
        topics.meter_report(RUN, "agent-1"),
        topics.presence(RUN, 1, 1),
        topics.snapshot(RUN, "maml", "latest"),
        topics.learned(RUN, "maml", ".."),
        topics.BROKER_METER,
    ],
)
def test_garbage_is_left_out_and_recording_goes_on(table: Table, topic: str) -> None:
    table.others.publish(topic, b"\xff garbage")
    table.row(1, 1)
    table.pump()
    assert len(table.recorder.rows) == 1
    assert sorted(table.recorder.waiting_for) == CLIENTS
    assert [path for path in table.path.parent.rglob("*.safetensors") if path.parent.name != "weights"] == []


LONG = "x" * 5000  # no file can have such a name


def test_what_no_process_of_this_run_can_have_said_is_refused(table: Table) -> None:
    model = encode_model({"w": np.ones(2, np.float32)}, ModelHeader(task=1, agent=1, round=1))
    here = encode_json(Presence(agent=7, state="gone"))
    for topic, payload in [
        (topics.learned(RUN, LONG, 1), model),
        (topics.learned(RUN, "fl", LONG), model),
        (topics.learned(RUN, "fl", 2), model),
        (topics.snapshot(RUN, "fl", 1), model),
        (topics.snapshot(RUN, "maml", 2), model),
        (topics.meter_report(RUN, "agent-1"), encode_json(MeterReport(client="agent-2", rows=[], rounds=[]))),
        (topics.meter_report(RUN, "agent-7"), encode_json(MeterReport(client="agent-7", rows=[], rounds=[]))),
        (topics.presence(RUN, 1, 1), encode_json(Presence(agent=2, state="gone"))),
        (topics.presence(RUN, 1, 7), here),
        (topics.presence(RUN, "x", "y"), here),
        (topics.meter_report(RUN, "round"), encode_json(Telemetry(row=made(1, 1), received={}))),  # of too few levels
        (topics.meter_report(RUN, "learned"), model),
        (topics.meter_report(RUN, "snapshot"), model),
    ]:
        table.others.publish(topic, payload)
    table.row(7, 1)
    table.row(1, 1, client="agent-2")
    table.row(1, 1, task=2)
    table.row(1, 1, arm="sarsa")
    table.row(1, 201)  # federation.max_rounds is 200
    table.pump_all(refused=18)
    assert table.recorder.refused == 18
    assert (table.recorder.rows, list((table.path / "weights").iterdir())) == ([], [])
    assert sorted(table.recorder.waiting_for) == CLIENTS


def test_a_reward_that_is_no_number_is_refused(table: Table) -> None:
    table.row(1, 1, reward=1.5)
    told = table.recorder._bus.receive(DEADLINE_S)
    assert told is not None
    table.others.publish(told.topic, bytes(told.payload).replace(b'"reward":1.5', b'"reward":NaN'))
    table.pump_all(refused=1)
    assert (table.recorder.refused, table.recorder.rows) == (1, [])


def test_a_process_that_died_and_does_not_come_back_ends_the_run(table: Table) -> None:
    table.present(2, "gone")
    table.pump()
    table.recorder.check()  # a lost connection may be won back for a while
    for _ in range(10):  # longer than bus.connect_timeout_s
        table.pump()
    table.recorder.check(restarted=True)  # by somebody else, who may take his time
    with pytest.raises(RunError, match="agent-2 died"):
        table.recorder.check()


@pytest.mark.parametrize("sign", ["presence", "row", "report"])
def test_a_process_that_comes_back_in_time_is_forgiven(table: Table, sign: str) -> None:
    table.present(0, "gone")
    if sign == "presence":
        table.present(0, "here")
    elif sign == "row":
        table.row(0, 1, client="datacenter")
    else:
        table.report("datacenter")
    for _ in range(10):  # longer than bus.connect_timeout_s
        table.pump()
        table.recorder.check()


def test_a_process_that_died_when_all_was_handed_in_does_not_end_the_run(table: Table) -> None:
    table.report("agent-2")
    table.present(2, "gone")
    for _ in range(10):  # longer than bus.connect_timeout_s
        table.pump()
        table.recorder.check()
    assert table.recorder.waiting_for == ["agent-1", "datacenter"]


def test_a_process_that_is_back_after_its_report_is_waited_for_again_as_long_as_it_lives(table: Table) -> None:
    for client in CLIENTS:
        table.report(client)
    table.present(2, "here")
    table.pump()
    assert table.recorder.waiting_for == ["agent-2"]
    table.present(2, "gone")
    table.pump()
    assert table.recorder.waiting_for == []
    table.present(2, "here")
    table.report("agent-2")
    table.pump()
    assert table.recorder.waiting_for == []


def tell_wait(table: Table, client: str, what: str, quiet_s: float = 0.0) -> None:
    wait = Wait(client=client, what=what, quiet_s=quiet_s)
    table.others.publish(topics.wait(RUN, "recorder"), encode_json(wait))
    table.pump()


def test_who_waits_for_what_is_known_the_longest_first_until_it_gets_on(table: Table) -> None:
    assert table.recorder.waits == []
    tell_wait(table, "agent-1", "round 8 of robots [2]", 20)
    tell_wait(table, "datacenter", "round 3 of robots [1]", 100)
    assert table.recorder.waits == [
        "datacenter waits for round 3 of robots [1] (100 s)", "agent-1 waits for round 8 of robots [2] (20 s)",
    ]  # fmt: skip
    table.row(0, 1, client="datacenter")
    table.report("agent-1")
    table.pump()
    assert table.recorder.waits == []


def test_of_who_tells_what_it_waits_for_it_is_not_said_that_nothing_is_heard(table: Table) -> None:
    table.recorder._attendance._patience._from_s -= 100  # so long ago it has begun
    tell_wait(table, "agent-1", "round 8 of robots [2]", 100)
    told = {wait.rpartition(" (")[0] for wait in table.recorder.waits}
    assert told == {
        "agent-1 waits for round 8 of robots [2]", "nothing heard of agent-2", "nothing heard of datacenter",
    }  # fmt: skip


def test_who_is_not_heard_of_is_named_and_ends_the_run_at_the_limit(scenario: Scenario, tmp_path: Path) -> None:
    federation = scenario.federation.model_copy(update={"give_up_after_s": 0.2})
    bus = scenario.bus.model_copy(update={"resend_after_s": 0.01})
    table = Table(scenario.model_copy(update={"federation": federation, "bus": bus}), tmp_path / "run")
    for client in ("agent-1", "datacenter"):
        table.report(client)
    table.pump()
    assert [wait[:-6] for wait in table.recorder.waits] == ["nothing heard of agent-2"]

    def watch() -> None:
        while True:
            table.pump()
            table.recorder.check()

    with pytest.raises(RunError, match=r"waiting for agent-2: agent-2 was not heard of within the 0\.2 s"):
        watch()


def test_the_presence_of_who_is_done_is_removed_and_who_stays_is_told_and_seen_off(table: Table) -> None:
    ears = table.hub.connect("ears")
    table.present(1, "done")
    table.present(2, "here")
    table.present(0, "gone")
    for client in CLIENTS:
        table.report(client)
    table.report("agent-2")
    table.pump()
    ears.subscribe(topics.recorder(RUN))
    closing = threading.Thread(target=table.recorder.close, args=("complete",), daemon=True)
    closing.start()
    while (message := ears.receive(DEADLINE_S)) and decode_json(message.payload, Presence).state != "done":
        pass
    assert json.loads((table.path / "summary.json").read_text())["status"] == "complete"  # by now it is written
    table.others.publish(topics.presence(RUN, 1, 2), b"", retain=True)  # robot 2 leaves
    closing.join(DEADLINE_S)
    assert not closing.is_alive()
    late = table.hub.connect("late")
    late.subscribe(topics.presence(RUN, "+", "+"), topics.recorder(RUN))
    assert late.receive(0.001) is None


def test_a_run_that_was_not_recorded_whole_is_not_said_to_be(table: Table) -> None:
    ears = table.hub.connect("ears")
    table.present(1, "done")
    table.present(2, "here")
    table.pump()
    ears.subscribe(topics.recorder(RUN), topics.presence(RUN, "+", "+"))
    table.recorder.close("interrupted")
    said = [(message.topic, bytes(message.payload)) for message in iter(lambda: ears.receive(0.001), None)]
    assert said[3:] == [(topics.recorder(RUN), b""), (topics.presence(RUN, 1, 1), b"")]


def client_counters(client: str, topic: str, direction: Any, payload: int) -> Meter:
    meter = Meter("client")
    meter.count(client, topic, direction, payload, payload + 40)
    return meter


WEIGHTS = topics.weights(RUN, "maml", 1, 1)


def test_without_an_embedded_broker_the_clients_counters_feed_the_bill(table: Table) -> None:
    table.row(1, 1)
    table.row(2, 1)
    table.report("agent-2", client_counters("agent-2", WEIGHTS, "in", 1000))
    table.report("agent-1", client_counters("agent-1", WEIGHTS, "out", 1000))
    table.pump()
    table.recorder.close("complete")
    assert {row["side"] for row in table.lines("meter.jsonl")} == {"client"}
    assert {row["client"] for row in table.lines("meter.jsonl")} == {"agent-1", "agent-2", "recorder"}
    summary = table.json("summary.json")
    assert (summary["status"], summary["metered_by"], summary["seed"]) == ("complete", "client", 4)
    assert summary["arms"]["maml"]["bytes"]["sidelink"] == {"messages": 1, "payload": 1000, "packet": 1040}


@pytest.mark.parametrize("status", ["interrupted", "failed"])
def test_a_run_cut_short_is_summed_up_as_far_as_it_got(table: Table, status: Any) -> None:
    table.row(1, 1, reward=10.0, cluster_reward=12.0, gradients=20)
    table.row(2, 1, reward=14.0, cluster_reward=12.0, gradients=20)
    table.pump()
    table.recorder.close(status)
    summary = table.json("summary.json")
    assert summary["status"] == status
    assert summary["arms"]["maml"]["tasks"] == [
        {
            "task": 1,
            "rounds": 1,
            "reward": 12.0,
            "rmse_m": None,
            "learned": False,
            "robot_rounds": 2,
            "full_window": None,
            "partial_window": None,
            "missed_exits": None,
            "episodes": 0,
        }
    ]
    # 40 gradients x 5.1 W x 0.4 s
    assert summary["arms"]["maml"]["energy_j"]["literal"]["fl_learning"] == pytest.approx(81.6)


def test_the_manifest_says_what_each_process_computes_on_and_another_one_is_told(
    table: Table, caplog: pytest.LogCaptureFixture
) -> None:
    (table.path / MANIFEST).write_text(json.dumps({"run": RUN}))
    for agent, processor in ((1, "one"), (2, "one"), (1, "one"), (2, "other"), (0, "other")):
        presence = Presence(agent=agent, processor=processor)
        table.others.publish(topics.presence(RUN, 1 if agent else 0, agent), encode_json(presence), retain=True)
        table.pump()
    expected = {"agent-1": ["one"], "agent-2": ["one", "other"], "datacenter": ["other"]}
    assert table.json(MANIFEST) == {"run": RUN, "host": {"computed_on": expected}}
    told = "agent-2 computes on other, others on one: weights may be others than on one alone"
    assert [record.getMessage() for record in caplog.records] == [told]
