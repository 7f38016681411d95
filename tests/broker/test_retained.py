"""Retained messages and last wills."""

from __future__ import annotations


def test_retained_message_goes_to_matching_new_subscriptions_only(broker, raw):
    publisher, matching, other = raw(broker), raw(broker), raw(broker)
    publisher.connect("p")
    publisher.publish("state/1", b"kept", 1, retain=True)
    matching.connect("m")
    matching.subscribe("state/+", 1)
    first, topic, _, payload = matching.read_publish()
    assert (first, topic, payload) == (0x33, "state/1", b"kept")  # QoS 1 and the retain flag
    other.connect("o")
    other.subscribe("else/#", 1)
    other.ping()
    matching.send(0x40, b"\x00\x01")
    matching.ping()  # neither was the first one served again by the other's subscription


def test_retained_message_does_not_come_back_to_a_persistent_session_without_subscription(broker, raw):
    publisher, other = raw(broker), raw(broker)
    other.connect("o", clean=False)
    publisher.connect("p")
    publisher.publish("state/1", b"kept", 1, retain=True)
    again = raw(broker)
    assert again.connect("o", clean=False) == 1
    again.ping()


def test_existing_subscription_gets_it_without_the_retain_flag(broker, raw):
    publisher, subscriber = raw(broker), raw(broker)
    publisher.connect("p")
    subscriber.connect("s")
    subscriber.subscribe("state/1", 0)
    publisher.publish("state/1", b"new", 1, retain=True)
    assert subscriber.read_publish() == (0x30, "state/1", b"", b"new")


def test_retained_message_is_replaced_and_cleared_by_an_empty_one(broker, raw):
    publisher, second, third = raw(broker), raw(broker), raw(broker)
    publisher.connect("p")
    publisher.publish("state/1", b"old", 1, retain=True)
    publisher.publish("state/1", b"new", 1, retain=True)
    second.connect("2")
    second.subscribe("state/1", 0)
    assert second.read_publish() == (0x31, "state/1", b"", b"new")
    publisher.publish("state/1", b"", 1, retain=True)
    third.connect("3")
    third.subscribe("state/1", 0)
    third.ping()


def test_will_is_published_and_retained_when_a_client_dies(broker, raw, bus):
    watcher = raw(broker)
    watcher.connect("w")
    watcher.subscribe("presence/#", 0)
    mortal = raw(broker)
    mortal.connect("m", will=("presence/m", b"gone"))
    mortal.close()
    assert watcher.read_publish() == (0x30, "presence/m", b"", b"gone")


def test_bus_will_is_retained(broker, raw, bus):
    mortal = bus(broker, "agent-1", will=("presence/1", b"gone"))
    taker = raw(broker)
    taker.connect(mortal._paho._client_id.decode())  # takes the id over: an abnormal end
    late = raw(broker)
    late.connect("late")
    late.subscribe("presence/+", 1)
    first, topic, _, payload = late.read_publish()
    assert (first & 0xF0, topic, payload) == (0x30, "presence/1", b"gone")


def test_will_is_not_published_after_disconnect(broker, raw):
    watcher, polite = raw(broker), raw(broker)
    watcher.connect("w")
    watcher.subscribe("presence/#", 0)
    polite.connect("m", will=("presence/m", b"gone"))
    polite.send(0xE0)
    assert polite.is_closed_by_broker()
    watcher.ping()


def test_will_is_published_when_a_client_breaks_the_protocol(broker, raw):
    watcher, rude = raw(broker), raw(broker)
    watcher.connect("w")
    watcher.subscribe("presence/#", 0)
    rude.connect("m", will=("presence/m", b"gone"))
    rude.send(0xF0)
    assert watcher.read_publish()[3] == b"gone"
