"""What is asked of a broker before anybody computes: is the run new to it, and does the largest message come through?

A broker of ours tells its limit. Others are tried: one may close the connection, which the bus notices, and one
(Mosquitto with message_size_limit) acknowledges what is too large and drops it, which nothing else would show.
"""

from __future__ import annotations

import logging
import secrets
import time

from jouleswarm.codecs.codec import codec_of
from jouleswarm.codecs.floats import FLOAT32
from jouleswarm.codecs.observations import experience_bytes, experience_codec_of
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.errors import ConfigurationError, MessageTooLargeError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.names import client_of
from jouleswarm.runs.interface import interface_of
from jouleswarm.runs.sizes import meta_model_shapes, model_shapes, weights_bytes
from jouleswarm.runs.traffic import DATA_CENTER

log = logging.getLogger("jouleswarm.recorder")

ANSWER_S, LARGE_ANSWER_S = 5.0, 60.0


def check_largest_message(bus: MqttBus, scenario: Scenario, run: str) -> None:
    """Send a message of the largest size around, unless the broker has told its limit.

    On a bus that nothing else has been subscribed to. A broker that lets the recorder hear nothing is not judged.

    Raises:
        MessageTooLargeError: it is too large for the broker.
    """
    size_bytes, topic = largest_message(scenario, run)
    probe = topics.probe(run)
    try:
        bus.subscribe(probe)
    except ConfigurationError as error:
        log.info("the largest message is not tried: %s", error)
        return
    came = _comes_around(bus, probe, 0, ANSWER_S)  # what the broker tells of its limits comes before this
    bus.limit.check(topic, size_bytes, 1)
    if came and bus.limit.told_bytes is None:
        _try(bus, probe, size_bytes, topic)
    bus.unsubscribe(probe)


def check_is_new(bus: MqttBus, scenario: Scenario, run: str) -> None:
    """Find out whether a broker still has what processes of another run by this name have left there.

    On a bus that nothing else has been subscribed to, before any process of the run is started. A broker that lets the
    recorder hear nothing is not judged.

    Raises:
        ConfigurationError: it has. Processes would take that for word of each other.
    """
    probe, token, left = topics.probe(run), secrets.token_bytes(8), set[str]()
    places = {client_of(agent): (scenario.task_of(agent), agent) for agent in scenario.agents} | {DATA_CENTER: (0, 0)}
    present = {topics.presence(run, *place): client for client, place in places.items()}
    try:
        bus.subscribe(*present, probe)
    except ConfigurationError as error:
        log.info("it is not known whether the run is new at this broker: %s", error)
        return
    bus.publish(probe, token)  # what is retained comes before
    until = time.monotonic() + ANSWER_S
    while (message := bus.receive(max(0.0, until - time.monotonic()))) is not None and message.payload != token:
        if message.topic in present and message.payload:
            left.add(present[message.topic])
    bus.unsubscribe(*present, probe)
    if left:
        raise ConfigurationError(
            f"run {run}: the broker still has word of {', '.join(sorted(left))} of a run by this name, which was "
            "broken off or is under way; give another --run-id, or go on with that one by --resume"
        )


def _try(bus: MqttBus, probe: str, size_bytes: int, topic: str) -> None:
    try:
        came = _comes_around(bus, probe, size_bytes, LARGE_ANSWER_S)
    except MessageTooLargeError as error:
        raise MessageTooLargeError(f"{error}; those on {topic} are as large") from error
    if came is False:
        raise MessageTooLargeError(
            f"message of {size_bytes} bytes, as on {topic}: the broker acknowledges it and passes it on to nobody; "
            "raise its limit (Mosquitto: message_size_limit), or make what is sent smaller (network, experience_codec)"
        )


def largest_message(scenario: Scenario, run: str) -> tuple[int, str]:
    """Tensors of the largest message of a run, bytes, and a topic that it goes on. Headers come on top."""
    interface, codec = interface_of(scenario), codec_of(scenario)
    model = model_shapes(interface)
    frame_bytes = experience_bytes(experience_codec_of(scenario), interface.spaces.observation)
    task, robots = min(scenario.clusters.items())
    sizes = [(weights_bytes(FLOAT32, model, whole=True), topics.learned(run, scenario.arms[0].name, task))]
    sent = max(weights_bytes(codec, model, whole=whole) for whole in (True, False))
    sizes.append((sent, topics.weights(run, scenario.arms[0].name, task, min(robots))))
    for method in scenario.meta_methods:
        meta_model = meta_model_shapes(interface, scenario, method)
        largest = max(weights_bytes(each, meta_model, whole=True) for each in (FLOAT32, codec))
        sizes.append((largest, topics.meta_model(run, method)))
    for method in scenario.experience_methods:
        sizes.append((frame_bytes or 0, topics.experience(run, method, task, min(robots))))
    return max(sizes)


def _comes_around(bus: MqttBus, topic: str, size_bytes: int, within_s: float) -> bool | None:
    """Whether a message comes back before a short one that is sent after it; None if that does not come back either."""
    until = time.monotonic() + within_s
    while time.monotonic() < until:
        connections, came, token = bus.connections, False, secrets.token_bytes(8)
        bus.publish(topic, bytes(size_bytes))
        bus.publish(topic, token)
        while connections == bus.connections and time.monotonic() < until:  # else it may have been lost: once more
            message = bus.receive(0.1)
            if message is not None and message.payload == token:
                return came
            came = came or (message is not None and len(message.payload) == size_bytes)
    return None
