"""Broker, data center, robots and recorder as processes that a person starts one by one, in any order."""

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import safetensors.numpy

from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Presence, RoundRequest, decode_json
from tests.integration.conftest import on_the_wire

TOY = str(Path(__file__).parents[2] / "scenarios" / "toy.toml")
NAME = "by-hand"
DEADLINE_S = 60.0


def heard(bus: MqttBus, wanted: Callable[[Message], bool]) -> Message:
    """The first message that is wanted."""
    while message := bus.receive(DEADLINE_S):
        if wanted(message):
            return message
    pytest.fail("not heard")


def come_as_far_as(stage: int, task: int, agent: int) -> Callable[[Message], bool]:
    topic = topics.presence(NAME, task, agent)
    return lambda message: message.topic == topic and decode_json(message.payload, Presence).stage >= stage


def without(figures: list[dict[str, Any]], *names: str) -> list[dict[str, Any]]:
    return [{key: value for key, value in row.items() if key not in names} for row in figures]


def test_the_training_robot_comes_last_after_garbage_and_twins_who_are_refused_and_nothing_changes(
    broker: str, by_hand: Any, onlooker: Any, small_run: Any
) -> None:
    hand = by_hand(broker)
    ears = onlooker(broker, topics.presence(NAME, "+", "+"), topics.meta_round(NAME, "maml"))
    recorder = hand.recorder()
    center, *others = hand.data_center(), hand.robot(4, "--task", "2"), hand.robot(2), hand.robot(3)
    wanted = topics.meta_round(NAME, "maml")
    missing = {topics.presence(NAME, task, agent) for task, agent in ((0, 0), (1, 2), (2, 3), (2, 4))} | {wanted}
    retained = {}
    while missing:  # all wait for robot 1
        message = heard(ears, lambda message: message.topic in missing and bool(message.payload))
        missing.discard(message.topic)
        retained[message.topic] = message.payload
    assert decode_json(retained[wanted], RoundRequest) == RoundRequest(first=1, last=2)
    for twin, name in ((hand.robot(2), "robot 2"), (hand.data_center(), "the data center")):
        assert twin.ends() == 2, twin.printed
        assert f"{name} of this run is another process already, which goes on" in twin.printed.splitlines()[-1]
    ears.publish(topics.experience(NAME, "maml", 1, 1), b"garbage")
    ears.flush()
    others.append(hand.robot(1))

    run = hand.run(recorder)
    assert [process.ends() for process in (center, *others)] == [0] * 5
    assert run.weights == small_run.weights
    assert without(run.figures, "refused") == without(small_run.figures, "refused")
    refused = {(row["agent"], row["round"]): row["refused"] for row in run.figures if row["phase"] == "maml"}
    assert refused == {(0, 1): 1, (0, 2): 1, (1, 1): 0, (1, 2): 0}
    assert "refused a message on jouleswarm/by-hand/maml/ul/1/1/experience" in center.printed
    # Each round is a line where a person looks.
    assert "data center: maml, task 1, meta-learning round 2: " in center.printed
    assert [f"robot 4: fl, task 2, round {round_}: own reward " in others[0].printed for round_ in range(5)] == [
        True, True, True, True, False,
    ]  # fmt: skip
    # What was wanted stays on the broker only while it is wanted.
    late = onlooker(broker, wanted, topics.presence(NAME, 0, 0))
    assert late.receive(0.2) is None


def test_a_robot_that_comes_after_the_meta_model_went_by_gets_it_and_garbage_on_a_sidelink_changes_nothing(
    broker: str, by_hand: Any, onlooker: Any, small_run: Any
) -> None:
    hand = by_hand(broker)
    ears = onlooker(broker, topics.presence(NAME, "+", "+"))
    robots = [hand.robot(3), hand.robot(1), hand.robot(2)]
    recorder = hand.recorder()
    center = hand.data_center()
    heard(ears, come_as_far_as(1, 2, 3))  # robot 3 has the meta-model and waits for its neighbour, robot 4
    model = on_the_wire(small_run.weights["maml-task2.safetensors"])
    ears.publish(topics.weights(NAME, "maml", 2, 4), model[:-4] + b"\0\0\xc0\x7f")
    ears.flush()
    robots.append(hand.robot(4))

    run = hand.run(recorder)
    assert [process.ends() for process in (center, *robots)] == [0] * 5
    assert run.weights == small_run.weights
    # The recorder came after the first robots, but before the data center without which nothing is reported.
    assert without(run.figures, "refused") == without(small_run.figures, "refused")
    refused = {(row["agent"], row["refused"]) for row in run.figures if row["phase"] == "fl"}
    assert refused == {(1, 0), (2, 0), (3, 1), (4, 0)}
    assert "is not finite" in robots[0].printed
    # Robot 4 was sent the meta-model by itself; the bytes delivered down are the same.
    down = run.summary["arms"]["maml"]["bytes"]["downlink"]
    assert down["payload"] == small_run.summary["arms"]["maml"]["bytes"]["downlink"]["payload"]


@pytest.mark.external
def test_an_external_broker_serves_and_the_clients_counters_feed_the_bill(
    mosquitto: str, start: Any, read_run: Any, small: tuple[str, ...], small_run: Any, tmp_path: Path
) -> None:
    saved = tmp_path / "w.safetensors"
    topic = topics.weights("external", "maml", 2, 3)
    port = mosquitto.rpartition(":")[2]
    with saved.open("wb") as file:
        onlooker = subprocess.Popen(["mosquitto_sub", "-p", port, "-C", "1", "-N", "-q", "1", "-t", topic], stdout=file)
    run = start.jouleswarm(
        "run", TOY, "--broker", mosquitto, "--run-id", "external", "--out", str(tmp_path), "--details",
        *(part for each in small for part in ("--set", each)),
    )  # fmt: skip
    assert run.ends() == 0, run.printed
    assert onlooker.wait(DEADLINE_S) == 0

    done = read_run(tmp_path / "external", run.printed)
    assert done.summary["metered_by"] == "client"
    assert "Metered by the clients' own counters, for the broker is not JouleSwarm's" in done.printed
    assert done.manifest["broker"] == {"embedded": False, "url": mosquitto}
    assert {row["side"] for row in done.lines("meter.jsonl")} == {"client"}
    assert done.figures == small_run.figures
    assert done.weights == small_run.weights
    # What mosquitto_sub heard on the way is nobody's energy: the bill is as without it.
    for arm, name_bytes in (("maml", 3), ("fl", 3)):  # `external` is three bytes longer than `small`
        for link in ("uplink", "downlink", "sidelink"):
            ours, theirs = (each.summary["arms"][arm]["bytes"][link] for each in (done, small_run))
            assert ours["payload"] == theirs["payload"]
            assert ours["packet"] == theirs["packet"] + name_bytes * theirs["messages"]
        ours, theirs = (each.summary["arms"][arm]["energy_j"]["literal"] for each in (done, small_run))
        assert ours == theirs

    with safetensors.safe_open(saved, framework="np") as file:
        metadata = file.metadata()
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    assert (metadata["schema"], metadata["task"], metadata["agent"]) == ("jouleswarm.model/1", "2", "3")
    assert metadata["round"] == "1"
    learned = safetensors.numpy.load(small_run.weights["maml-task2.safetensors"])
    assert {name: tensor.shape for name, tensor in tensors.items()} == {n: t.shape for n, t in learned.items()}


def test_mosquitto_sub_saves_weights_from_the_embedded_broker_too(
    broker: str, onlooker: Any, small_run: Any, tmp_path: Path
) -> None:
    saved = tmp_path / "w.safetensors"
    try:
        with saved.open("wb") as file:
            command = ["mosquitto_sub", "-p", broker.rpartition(":")[2], "-C", "1", "-N", "-t", "jouleswarm/+/+/sl/#"]
            listening = subprocess.Popen(command, stdout=file)
    except FileNotFoundError:
        pytest.skip("mosquitto_sub is not installed")
    payload = small_run.weights["maml-task1.safetensors"]
    sender = onlooker(broker)
    while listening.poll() is None:  # until it has subscribed, and got one
        sender.publish(topics.weights("r", "maml", 1, 1), payload)
        sender.receive(0.05)
    assert listening.returncode == 0
    assert saved.read_bytes() == payload
    assert safetensors.numpy.load_file(saved)


def test_a_robot_that_dies_ends_the_recording_with_its_name(
    by_hand: Any, broker: str, small: Any, onlooker: Any, read_run: Any
) -> None:
    hand = by_hand(broker, overrides=(*small, "federation.max_rounds=200", "bus.connect_timeout_s=1", "methods=['fl']"))
    ears = onlooker(broker, topics.telemetry(NAME, "+", "+"))
    recorder = hand.recorder()
    robots = [hand.robot(agent) for agent in (1, 2, 3, 4)]
    heard(ears, lambda message: "/agent-2/" in message.topic)
    robots[1].process.kill()
    assert recorder.ends() == 5
    assert "agent-2 died, its connection broke off" in recorder.printed
    assert read_run(hand.out / NAME).summary["status"] == "failed"
    assert all(robot.process.poll() is None for robot in (robots[0], *robots[2:]))  # they wait for it to come back
