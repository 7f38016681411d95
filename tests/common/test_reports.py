"""What processes hand in to the recorder."""

from common import topics
from common.bus import MemoryHub
from common.payloads import Presence, decode_json, encode_json
from common.reports import MeterReport, Telemetry, leave, publish_row
from common.runlog import RoundRow

ROW = RoundRow(phase="fl", arm="maml", task=1, agent=3, round=2, reward=51.5, seconds=0.25)


def test_a_row_travels_with_what_its_sender_had_received() -> None:
    hub = MemoryHub()
    robot, neighbour, recorder = hub.connect("agent-3"), hub.connect("agent-4"), hub.connect("recorder")
    robot.subscribe(topics.weights("r", "maml", 1, 4))
    recorder.subscribe(topics.telemetry("r", "+", "+"))
    neighbour.publish(topics.weights("r", "maml", 1, 4), b"12345")
    publish_row(robot, "r", ROW)
    message = recorder.receive(0)
    assert message is not None
    assert message.topic == "jouleswarm/r/maml/tlm/agent-3/round"
    told = decode_json(message.payload, Telemetry)
    assert told.row == ROW
    assert told.received == {"uplink": 0, "downlink": 0, "sidelink": 5, "control": 0}


def test_who_leaves_clears_its_presence_and_hands_in_counters_that_are_final() -> None:
    hub = MemoryHub()
    robot, neighbour, recorder = hub.connect("agent-3"), hub.connect("agent-4"), hub.connect("recorder")
    recorder.subscribe(topics.meter_report("r", "+"))
    here = topics.presence("r", 1, 3)
    weights = topics.weights("r", "maml", 1, 4)
    robot.subscribe(weights)
    robot.publish(here, encode_json(Presence(agent=3, stage=2)), retain=True)
    neighbour.publish(weights, b"12345")
    leave(robot, "r", [weights], here)
    neighbour.publish(weights, b"too late")

    message = recorder.receive(0)
    assert message is not None
    report = decode_json(message.payload, MeterReport)
    assert report.client == "agent-3"
    assert report.rows == robot.meter.rows()
    received = [row for row in report.rows if row.direction == "in"]
    assert [(row.topic, row.messages, row.payload_bytes) for row in received] == [(weights, 1, 5)]

    late = hub.connect("late")
    late.subscribe(here)
    assert late.receive(0.001) is None  # an empty retained message removes the old one
