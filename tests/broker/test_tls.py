"""TLS: large and small messages both ways, and connections that cannot come about."""

from __future__ import annotations

import datetime
import shutil
import socket
import time
from dataclasses import replace
from pathlib import Path

import pytest

from jouleswarm.common.bus.credentials import Credentials, credentials_of
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.bus.tls import RECORD_BYTES, records
from jouleswarm.common.errors import BrokerUnreachableError, ConfigurationError, JouleSwarmError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire import topics
from jouleswarm.fleet.keys import make_keys

TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"
SOON_S = 5.0
"""A mistake is told well before `connect_timeout_s`, which is 30 s."""


@pytest.fixture
def robot(bus, guarded, keys):
    """Connects a robot of the toy scenario."""

    def connect(agent: int, **options) -> MqttBus:
        return bus(guarded, f"agent-{agent}", credentials=credentials_of(keys, f"agent-{agent}"), **options)

    return connect


def failure(url: str, credentials: Credentials | None, client: str = "agent-1") -> JouleSwarmError:
    begun = time.monotonic()
    with pytest.raises(JouleSwarmError) as caught:
        MqttBus.connect(url, client, credentials=credentials)
    assert time.monotonic() - begun < SOON_S
    assert "\n" not in str(caught.value)
    return caught.value


def packet_bytes(broker, client: str, direction: str) -> float:
    """Of sidelinks, as the broker counts them."""
    wanted = (f'client="{client}"', f'direction="{direction}"', 'link="sidelink"')
    counted = broker.scrape().items()
    return sum(n for name, n in counted if "packet_bytes_total" in name and all(each in name for each in wanted))


def test_records_are_the_stream_in_pieces() -> None:
    assert RECORD_BYTES == 16384
    pieces = records([b"a" * 3, b"", memoryview(b"b" * 20000), b"c" * 5])
    assert [bytes(each) for each in pieces] == [b"a" * 3 + b"b" * 16381, b"b" * 3619 + b"c" * 5]
    assert [len(each) for each in records([b"x" * 40000])] == [16384, 16384, 7232]
    assert list(records([])) == []


def test_large_messages_go_both_ways_at_once(robot, guarded) -> None:
    robots = {agent: robot(agent) for agent in (1, 2)}
    sent = {agent: bytes([agent, 0, 255]) * 2_000_000 for agent in robots}  # 6 MB
    for agent, bus in robots.items():
        bus.subscribe(topics.weights("r", "fl", 1, 3 - agent))
    for agent, bus in robots.items():
        bus.publish(topics.weights("r", "fl", 1, agent), sent[agent])
    for agent, bus in robots.items():
        message = bus.receive(20)
        assert message is not None
        assert message.payload == sent[3 - agent]
    # Packets as without TLS: 1 + 4 (length) + 2 + 30 (topic) + 2 (identifier) + payload.
    assert len(topics.weights("r", "fl", 1, 1)) == 30
    for agent, bus in robots.items():
        bus.flush()
        rows = {row.direction: row for row in bus.meter.rows() if "/sl/" in row.topic}
        assert rows["out"].packet_bytes == rows["in"].packet_bytes == 6_000_000 + 39
        for direction in ("in", "out"):
            assert packet_bytes(guarded, f"agent-{agent}", direction) == 6_000_039


def test_a_message_to_many_and_many_small_ones_arrive_in_order(robot) -> None:
    sender, receiver = robot(3), robot(4)
    receiver.subscribe(topics.weights("r", "fl", 2, 3))
    sizes = [(number * 7919) % 40_000 for number in range(1500)]  # 0 to 40 kB, 30 MB in all
    for number, size in enumerate(sizes):
        sender.publish(topics.weights("r", "fl", 2, 3), number.to_bytes(4, "big") + bytes(size), qos=number % 2)
    for number, size in enumerate(sizes):
        message = receiver.receive(20)
        assert message is not None
        assert bytes(message.payload[:4]) == number.to_bytes(4, "big")
        assert len(message.payload) == 4 + size


def test_packets_that_share_a_record_are_all_read(raw, guarded, keys) -> None:
    own = credentials_of(keys, "agent-1")
    client = raw(guarded, own.context())
    client.connect("agent-1", login=("agent-1", own.password))
    # One record: a PUBLISH at QoS 1 of 2 + 30 + 2 + 5000 = 5034 = 0x2a + 39 * 128 bytes, and three PINGREQ.
    topic = topics.weights("r", "fl", 1, 1).encode()
    publish = b"\x32\xaa\x27" + b"\x00\x1e" + topic + b"\x00\x07" + b"x" * 5000
    client.sock.sendall(publish + b"\xc0\x00" * 3)
    assert client.read() == (0x40, b"\x00\x07")
    assert [client.read() for _ in range(3)] == [(0xD0, b"")] * 3


def test_a_subscriber_that_does_not_read_slows_nobody_and_gets_all(raw, robot, guarded, keys) -> None:
    own = credentials_of(keys, "agent-2")
    lazy = raw(guarded, own.context())
    lazy.connect("agent-2", login=("agent-2", own.password))
    lazy.subscribe(topics.weights("r", "fl", 1, 1), qos=0)
    sender = robot(1)
    for number in range(8):
        sender.publish(topics.weights("r", "fl", 1, 1), bytes([number]) * 4_000_000)
    sender.flush()
    for number in range(8):
        *_, payload = lazy.read_publish()
        assert payload == bytes([number]) * 4_000_000


def test_untrusted_ca(guarded, keys, tmp_path) -> None:
    make_keys(load_scenario(TOY), tmp_path / "other", ["127.0.0.1"], days=2)
    error = failure(guarded.url, credentials_of(tmp_path / "other", "agent-1"))
    assert isinstance(error, ConfigurationError)
    assert "expected one signed by the CA" in str(error)
    # The broker's CA is trusted, but the client's certificate is another CA's.
    mixed = replace(credentials_of(tmp_path / "other", "agent-1"), ca=keys / "ca.crt")
    assert "refused this client's certificate" in str(failure(guarded.url, mixed))


def test_no_certificate(guarded, keys) -> None:
    error = failure(guarded.url, replace(credentials_of(keys, "agent-1"), certificate=None, key=None))
    assert "refused this client's certificate (certificate required)" in str(error)


def test_the_systems_authorities_do_not_know_the_brokers(guarded) -> None:
    assert "expected one signed by the CA" in str(failure(guarded.url, None))


def test_host_name_that_the_certificate_is_not_for(start_broker, tmp_path) -> None:
    make_keys(load_scenario(TOY), tmp_path / "keys", ["broker.example"], days=2)
    broker = start_broker("--keys", str(tmp_path / "keys"))
    error = failure(broker.url, credentials_of(tmp_path / "keys", "agent-1"))
    assert "expected one for 127.0.0.1" in str(error)
    assert "--hosts 127.0.0.1" in str(error)


def test_expired_certificate(start_broker, tmp_path, keys) -> None:
    long_ago = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=30)
    make_keys(load_scenario(TOY), tmp_path / "keys", ["127.0.0.1"], days=2, now=long_ago)
    broker = start_broker("--keys", str(tmp_path / "keys"))
    assert "expected one that has not expired" in str(failure(broker.url, credentials_of(tmp_path / "keys", "agent-1")))


def test_expired_client_certificate(start_broker, tmp_path) -> None:
    # The broker's own certificate is of a CA that holds; its client CA's clients are out of date.
    scenario, now = load_scenario(TOY), datetime.datetime.now(datetime.UTC)
    make_keys(scenario, tmp_path / "new", ["127.0.0.1"], days=2)
    make_keys(scenario, tmp_path / "old", ["127.0.0.1"], days=2, now=now - datetime.timedelta(days=30))
    broker = start_broker("--keys", str(tmp_path / "new"), "--tls-client-ca", str(tmp_path / "old" / "ca.crt"))
    old = replace(credentials_of(tmp_path / "old", "agent-1"), ca=tmp_path / "new" / "ca.crt")
    assert "refused this client's certificate (certificate expired)" in str(failure(broker.url, old))


def test_plain_connection_to_a_tls_port(guarded) -> None:
    error = failure(guarded.url.replace("mqtts", "mqtt"), None)
    assert isinstance(error, ConfigurationError)
    assert "got TLS, expected plain MQTT; give its URL as mqtts://" in str(error)
    guarded.counted("refused_tls", 1)


def test_tls_connection_to_a_plain_port_is_told_at_the_end(broker, keys) -> None:
    url = broker.url.replace("mqtt", "mqtts")
    with pytest.raises(BrokerUnreachableError, match="TLS handshake broke off"):
        MqttBus.connect(url, "agent-1", credentials=credentials_of(keys, "agent-1"), connect_timeout_s=1)


def test_keys_are_not_shown_to_a_port_without_tls(broker, keys) -> None:
    error = failure(broker.url, credentials_of(keys, "agent-1"))
    assert "the password would go unencrypted; expected mqtts://" in str(error)


def test_a_connection_that_never_shakes_hands_is_closed(start_broker, keys) -> None:
    broker = start_broker("--keys", str(keys), "--connect-timeout-s", "0.3")
    with socket.create_connection(("127.0.0.1", broker.port), timeout=20) as silent:
        assert silent.recv(1) == b""
    broker.counted("refused_connect_timeout", 1)


def test_a_missing_folder_is_told_before_anything_is_connected_to(tmp_path, keys) -> None:
    with pytest.raises(ConfigurationError, match=r"cannot read .*agent-9/password .*jouleswarm keys init"):
        credentials_of(keys, "agent-9")
    shutil.copytree(keys / "agent-1", tmp_path / "agent-1")
    (tmp_path / "agent-1" / "ca.crt").write_text("no certificate")
    with pytest.raises(ConfigurationError, match=r"cannot use .*ca\.crt"):
        credentials_of(tmp_path, "agent-1").context()
    assert credentials_of(None, "agent-1") is None


def test_a_password_is_not_shown_by_its_credentials(keys) -> None:
    own = credentials_of(keys, "agent-1")
    assert len(own.password) == 43  # 32 random bytes in base64 without padding
    assert own.password not in repr(own)
