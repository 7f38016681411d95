"""Before a run: does its largest message come through the broker?"""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.common.bus.address import BrokerAddress
from jouleswarm.common.bus.bus import MemoryBus, MemoryHub, Message
from jouleswarm.common.bus.size_limit import SizeLimit
from jouleswarm.common.errors import ConfigurationError, MessageTooLargeError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.fleet import preflight
from jouleswarm.fleet.preflight import check_is_new, check_largest_message, largest_message

TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"
# Two convolutions (4x4 on 4 channels to 8, 3x3 to 16) leave 16 x 5 x 3 of 16 x 12; 32 units; 4 actions. The meta-model
# has a last layer for its one training task beside that.
TOY_BYTES = 4 * ((4 * 4 * 4 * 8 + 8) + (3 * 3 * 8 * 16 + 16) + (240 * 32 + 32) + 2 * (32 * 4 + 4))


class Bus(MemoryBus):
    """To a broker that acknowledges what is larger than `drops_over` and drops it, or tells its limit, or is deaf."""

    limit: SizeLimit
    drops_over = 10**9
    is_deaf = False
    loses = 0

    def publish(self, topic: str, payload: bytes, *, qos: int = 1, retain: bool = False) -> None:  # type: ignore[override]
        self.sent = [*getattr(self, "sent", []), len(payload)]
        if self.loses and len(payload) > 8:
            self.loses, self.connections = self.loses - 1, self.connections + 1
        elif len(payload) <= self.drops_over:
            super().publish(topic, payload, qos=qos, retain=retain)

    def receive(self, timeout_s: float | None = None) -> Message | None:
        return None if self.is_deaf else super().receive(timeout_s)


@pytest.fixture
def bus() -> Bus:
    hub = MemoryHub()
    hub._clients["recorder"] = bus = Bus("recorder", hub)
    bus.limit = SizeLimit(BrokerAddress("broker", 1883))
    return bus


@pytest.fixture
def scenario() -> Scenario:
    return load_scenario(TOY)


def test_the_largest_message_is_a_model_or_a_frame(scenario: Scenario) -> None:
    assert largest_message(scenario, "r") == (TOY_BYTES, "jouleswarm/r/maml/dl/meta")
    large_frames = load_scenario(TOY, ["camera.width=640", "camera.height=480", "meta.experience_codec=raw"])
    assert largest_message(large_frames, "r") == (640 * 480 * 4, "jouleswarm/r/maml/ul/1/1/experience")


def test_a_broker_that_passes_it_on_is_right(bus: Bus, scenario: Scenario) -> None:
    check_largest_message(bus, scenario, "r")
    assert bus.sent == [0, 8, TOY_BYTES, 8]
    assert bus.meter.rows() == []
    bus.publish("jouleswarm/r/meter/recorder/probe", b"")
    assert bus.receive(0) is None  # nothing is heard there any more


def test_a_broker_that_drops_it_is_named_with_topic_and_size(bus: Bus, scenario: Scenario) -> None:
    bus.drops_over = TOY_BYTES - 1
    with pytest.raises(MessageTooLargeError, match=rf"message of {TOY_BYTES} bytes, as on jouleswarm/r/maml/dl/meta: "):
        check_largest_message(bus, scenario, "r")


def test_a_limit_that_is_told_is_enough(bus: Bus, scenario: Scenario) -> None:
    body_bytes = 2 + len("jouleswarm/r/maml/dl/meta") + 2 + TOY_BYTES
    bus.limit.told_bytes = body_bytes
    check_largest_message(bus, scenario, "r")
    bus.limit.told_bytes = body_bytes - 1
    with pytest.raises(MessageTooLargeError, match=f"message of {body_bytes} bytes on jouleswarm/r/maml/dl/meta: "):
        check_largest_message(bus, scenario, "r")
    assert TOY_BYTES not in bus.sent


def test_what_a_lost_connection_swallowed_is_tried_again(bus: Bus, scenario: Scenario) -> None:
    bus.loses = 2
    check_largest_message(bus, scenario, "r")
    assert bus.sent.count(TOY_BYTES) == 3


def test_a_broker_that_lets_the_recorder_hear_nothing_is_not_judged(
    bus: Bus, scenario: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(preflight, "ANSWER_S", 0.0)
    bus.is_deaf = True
    check_largest_message(bus, scenario, "r")

    def refuse(*_: str, qos: int = 1) -> None:
        raise ConfigurationError("refused")

    monkeypatch.setattr(bus, "subscribe", refuse)
    check_largest_message(bus, scenario, "r")


def test_a_name_that_the_broker_has_word_of_is_told_with_whose(bus: Bus, scenario: Scenario) -> None:
    check_is_new(bus, scenario, "r")
    other = MemoryBus("other", bus._hub)
    for run, task, agent in (("r", 2, 3), ("r", 0, 0), ("another", 1, 1)):
        other.publish(f"jouleswarm/{run}/all/ctl/{task}/{agent}/presence", b"{}", retain=True)
    with pytest.raises(ConfigurationError, match=r"run r: .* still has word of agent-3, datacenter of a run by "):
        check_is_new(bus, scenario, "r")
    for task, agent in ((2, 3), (0, 0)):  # as at a run's end
        other.publish(f"jouleswarm/r/all/ctl/{task}/{agent}/presence", b"", retain=True)
    check_is_new(bus, scenario, "r")
    assert bus.receive(0) is None  # nothing of it is heard any more
