"""Logins and topic rights on a real broker, with the toy scenario's keys: robots 1, 2 in task 1, 3, 4 in task 2."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from types import SimpleNamespace

import pytest

from jouleswarm.broker.access import Guard, Refused
from jouleswarm.common.bus.credentials import Credentials, credentials_of
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire import topics

OTHERS = {
    "as another robot": topics.weights("r", "fl", 1, 2),
    "in another cluster": topics.weights("r", "fl", 2, 1),
    "another robot's presence": topics.presence("r", 1, 2),
    "another robot's experience": topics.experience("r", "maml", 1, 2),
    "another robot's telemetry": topics.telemetry("r", "fl", "agent-2"),
    "another robot's counters": topics.meter_report("r", "agent-2"),
    "the meta-model": topics.meta_model("r", "maml"),
    "the meta-model to one": topics.meta_model("r", "maml", 2),
    "a cluster's model": topics.cluster_model("r", "fedavg", 1),
    "the meta round": topics.meta_round("r", "maml"),
    "the broker's meter": topics.BROKER_METER,
    "a question to the broker": topics.BROKER_METER_ASK,
    "a request to another cluster": topics.resend("r", "fl", 2, 3),
    "a request that is the data center's": topics.collect_again("r", "maml", 1, 2),
    "something else": "elsewhere",
}


@pytest.fixture
def own(keys):
    return lambda client: credentials_of(keys, client)


@pytest.fixture
def join(bus, guarded, own):
    """Connects a client of the toy scenario."""

    def connect(client: str, **options) -> MqttBus:
        return bus(guarded, client, credentials=own(client), **options)

    return connect


def refused(url: str, credentials: Credentials, client: str = "agent-1", **options) -> str:
    with pytest.raises(ConfigurationError) as caught:
        MqttBus.connect(url, client, credentials=credentials, **options)
    assert credentials.password is None or credentials.password not in str(caught.value)
    return str(caught.value)


def test_a_client_with_its_own_keys_is_let_in_also_by_a_url_with_its_password(guarded, join, own, bus):
    join("agent-1")
    url = guarded.url.replace("//", f"//agent-2:{own('agent-2').password}@")
    by_url = MqttBus.connect(url, "agent-2", credentials=replace(own("agent-2"), user=None, password=None))
    by_url.close()
    assert guarded.event("refused_not_authorized") == 0


def test_wrong_password(guarded, own):
    message = refused(guarded.url, replace(own("agent-1"), password="wrong"))
    assert "refused user 'agent-1': bad user name or password; expected a user of the broker's users file" in message
    guarded.counted("refused_not_authorized", 1)


def test_unknown_user(guarded, own):
    assert "bad user name or password" in refused(guarded.url, replace(own("agent-1"), user="nobody"), "nobody")


def test_no_password(guarded, own):
    message = refused(guarded.url, replace(own("agent-1"), user=None, password=None))
    assert "refused a client without user and password" in message
    assert "give --keys FOLDER" in message


def test_a_user_that_is_not_the_clients_name(guarded, own):
    message = refused(guarded.url, own("agent-1"), "agent-2")
    assert "refused user 'agent-1': not authorized; expected a user and certificate of the client's own name" in message


def test_a_certificate_of_another_client(guarded, own):
    stolen = replace(own("agent-1"), certificate=own("agent-2").certificate, key=own("agent-2").key)
    assert "not authorized" in refused(guarded.url, stolen)


@pytest.mark.parametrize("topic", [OTHERS["another robot's presence"], topics.BROKER_METER, "elsewhere"])
def test_a_last_will_outside_the_rights(guarded, own, topic):
    assert "a last will within its rights" in refused(guarded.url, own("agent-1"), will=(topic, b"gone"))


def test_a_last_will_within_the_rights_is_published(guarded, join, raw, own):
    watcher = join("recorder")
    watcher.subscribe(topics.presence("r", "+", "+"))
    dying = raw(guarded, own("agent-1").context())
    dying.connect("agent-1", login=("agent-1", own("agent-1").password), will=(topics.presence("r", 1, 1), b"gone"))
    dying.close()
    message = watcher.receive(20)
    assert (message.topic, bytes(message.payload)) == (topics.presence("r", 1, 1), b"gone")


@pytest.mark.parametrize("what", OTHERS)
def test_a_robot_may_not_publish(guarded, join, what):
    robot = join("agent-1")
    for _ in range(2):
        robot.publish(OTHERS[what], b"x", retain=True)
    robot.flush()  # acknowledged, as MQTT 3.1.1 wants it; and dropped
    guarded.counted("refused_not_permitted", 2)


def test_what_may_not_be_published_reaches_nobody(guarded, join):
    center, robot, other = join("datacenter"), join("agent-1"), join("agent-3")
    model, forged = topics.meta_model("r", "maml"), topics.meta_round("r", "maml")
    other.subscribe(model, forged)
    robot.publish(model, b"forged")
    robot.publish(forged, b"forged", retain=True)
    robot.flush()
    center.publish(model, b"genuine")
    message = other.receive(20)
    assert (message.topic, bytes(message.payload)) == (model, b"genuine")
    late = join("agent-4")
    late.subscribe(forged)
    center.publish(forged, b"genuine", retain=True)
    assert bytes(late.receive(20).payload) == b"genuine"


@pytest.mark.parametrize(
    ("client", "topic_filter"),
    [
        ("agent-1", topics.weights("r", "fl", 2, 3)),
        ("agent-1", topics.weights("r", "fl", "+", "+")),
        ("agent-1", topics.experience("r", "maml", 1, 2)),
        ("agent-1", topics.presence("r", "+", "+")),
        ("agent-1", topics.meta_model("r", "maml", 2)),
        ("agent-1", topics.resend("r", "fl", 1, 2)),
        ("agent-1", topics.BROKER_METER),
        ("agent-1", "#"),
        ("agent-1", "jouleswarm/#"),
        ("agent-1", "jouleswarm/r/fl/sl/1/#"),
        ("agent-1", "$SYS/#"),
        ("recorder", topics.weights("r", "fl", 1, 1)),
        ("recorder", topics.experience("r", "maml", 1, 1)),
        ("datacenter", topics.weights("r", "fl", 1, 1)),
        ("datacenter", "#"),
        ("health", topics.BROKER_METER),
    ],
)
def test_a_filter_beyond_the_rights_is_refused(guarded, join, client, topic_filter):
    with pytest.raises(ConfigurationError, match="refused the subscription to"):
        join(client).subscribe(topic_filter)
    guarded.counted("refused_not_permitted", 1)


def test_nothing_is_delivered_by_a_granted_filter_that_a_line_denies(start_broker, bus, keys, own, tmp_path):
    rights = tmp_path / "rights"
    rights.write_text(
        "user agent-1\ntopic readwrite open/#\nuser agent-2\ntopic read open/#\ntopic deny open/secret/+\n"
    )
    broker = start_broker("--keys", str(keys), "--rights", str(rights))
    sender, receiver = (bus(broker, client, credentials=own(client)) for client in ("agent-1", "agent-2"))
    sender.publish("open/secret/kept", b"1", retain=True)
    sender.flush()
    receiver.subscribe("open/#")  # nothing retained comes by it
    sender.publish("open/secret/live", b"2")
    sender.publish("open/told", b"3")
    message = receiver.receive(20)
    assert (message.topic, bytes(message.payload)) == ("open/told", b"3")


def test_a_persistent_session_keeps_to_the_rights_and_to_its_user(guarded, raw, own, join):
    topic, login = topics.weights("r", "fl", 1, 2), ("agent-1", own("agent-1").password)
    first = raw(guarded, own("agent-1").context())
    first.connect("agent-1", clean=False, login=login)
    assert first.subscribe(topic) == 1
    first.send(0xE0)
    assert first.is_closed_by_broker()
    neighbour = join("agent-2")
    neighbour.publish(topic, b"meanwhile")
    neighbour.flush()
    thief = raw(guarded, own("agent-2").context())
    thief.connect("agent-1", clean=False, login=("agent-2", own("agent-2").password), code=5)
    again = raw(guarded, own("agent-1").context())
    assert again.connect("agent-1", clean=False, login=login) == 1
    assert again.read_publish()[3] == b"meanwhile"
    again.publish(topics.weights("r", "fl", 1, 2), b"x", qos=1)
    guarded.counted("refused_not_permitted", 1)


def test_traffic_goes_on_while_many_log_in_with_wrong_passwords(guarded, raw, own, join):
    sender, receiver = join("agent-1"), join("agent-2")
    receiver.subscribe(topics.weights("r", "fl", 1, 1))
    tls = own("agent-3").context()
    guessing = [raw(guarded, tls) for _ in range(20)]
    for each in guessing:  # all twenty wait for their turn, two at a time; ten are verified, which are too many
        each.send(0x10, b"\x00\x04MQTT\x04\xc2\x00\x00\x00\x07agent-3\x00\x07agent-3\x00\x05guess")
    sender.publish(topics.weights("r", "fl", 1, 1), b"through")
    assert bytes(receiver.receive(20).payload) == b"through"
    codes = [each.read()[1][1] for each in guessing]
    assert (codes.count(4), codes.count(3)) in ((10, 10), (11, 9))  # two are verified at one time
    guarded.counted("refused_not_authorized", codes.count(4))
    guarded.counted("refused_too_often", codes.count(3))


def test_users_and_rights_work_without_tls(start_broker, bus, keys, own):
    broker = start_broker("--users", str(keys / "broker" / "users"), "--rights", str(keys / "broker" / "rights"))
    url = broker.url.replace("//", f"//agent-1:{own('agent-1').password}@")
    robot = MqttBus.connect(url, "agent-1")
    with pytest.raises(ConfigurationError, match="refused the subscription"):
        robot.subscribe("#")
    robot.close()
    with pytest.raises(ConfigurationError, match="refused a client without user and password"):
        MqttBus.connect(broker.url, "agent-1")


@pytest.fixture
def guard(keys):
    guard = Guard(keys / "broker" / "users", keys / "broker" / "rights", timeout_s=20)
    yield guard
    guard.close()


def let_in(guard: Guard, user: str, password: str) -> bool:
    session = SimpleNamespace(username=user, client_id=user, password=password.encode(), ssl_object=None, will=None)
    try:
        asyncio.run(guard.admit(session, "192.0.2.1", lambda _: None))
    except Refused:
        return False
    return True


@pytest.fixture
def verifications(guard, monkeypatch):
    """Users of whom a password was verified, in order; of whom there is not, None."""
    seen, verify = [], guard._verify
    users = {encoded: user for user, encoded in guard.book.users.items()}
    monkeypatch.setattr(
        guard, "_verify", lambda encoded, password: seen.append(users.get(encoded)) or verify(encoded, password)
    )
    return seen


def test_who_comes_back_with_its_password_is_let_in_without_another_verification(guard, own, verifications):
    password = own("agent-1").password
    assert [let_in(guard, "agent-1", password) for _ in range(3)] == [True] * 3
    assert verifications == ["agent-1"]


def test_another_password_is_refused_after_the_right_one_and_does_not_replace_it(guard, own, verifications):
    password = own("agent-1").password
    given = (password, "guess", "", own("agent-2").password, password)
    assert [let_in(guard, "agent-1", each) for each in given] == [True, False, False, False, True]
    assert verifications == ["agent-1"] * 4


def test_what_was_refused_once_is_refused_again(guard, verifications):
    assert [let_in(guard, user, "guess") for user in ("agent-1", "agent-1", "nobody", "nobody")] == [False] * 4
    assert len(verifications) == 4


def test_one_users_password_lets_no_other_in(guard, own):
    assert let_in(guard, "agent-1", own("agent-1").password)
    assert not let_in(guard, "agent-2", own("agent-1").password)
