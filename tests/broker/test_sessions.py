"""Take-over, keepalive, persistent sessions."""

from __future__ import annotations

import pytest


@pytest.mark.parametrize("clean", [True, False])
def test_second_connection_with_the_same_id_takes_over(broker, raw, clean):
    old, new, publisher = raw(broker), raw(broker), raw(broker)
    old.connect("twin", clean=clean)
    old.subscribe("a", 0)
    assert new.connect("twin", clean=clean) == (0 if clean else 1)
    assert old.is_closed_by_broker()
    if clean:
        new.subscribe("a", 0)
    publisher.connect("p")
    publisher.publish("a", b"for the new one", 1)
    assert new.read_publish()[3] == b"for the new one"
    new.ping()
    broker.counted("taken_over", 1)


def test_taken_over_while_a_message_is_stuck_in_it(broker, raw):
    old, publisher = raw(broker), raw(broker)
    old.connect("twin")
    old.subscribe("a", 0)
    publisher.connect("p")
    for _ in range(6):
        publisher.publish("a", bytes(5_000_000), 1)
    new = raw(broker)
    new.connect("twin")
    new.ping()


def test_silent_client_is_dropped_after_one_and_a_half_keepalives_and_its_will_published(broker, raw):
    watcher, silent = raw(broker), raw(broker)
    watcher.connect("w")
    watcher.subscribe("presence/#", 0)
    silent.connect("s", keepalive_s=1, will=("presence/s", b"silent"))
    assert watcher.read_publish()[3] == b"silent"
    assert silent.is_closed_by_broker()
    broker.counted("dropped_silent", 1)


def test_client_that_pings_is_not_silent(broker, raw):
    pinging, silent = raw(broker), raw(broker)
    pinging.connect("p", keepalive_s=1)
    silent.connect("s", keepalive_s=2)
    pinging.sock.settimeout(0.3)
    pings = 0
    while True:  # until the other one has been dropped, which takes two keepalives and more of this one
        pinging.ping()
        pings += 1
        if silent.is_closed_by_broker(within_s=0.3):
            break
        assert pings < 60
    pinging.ping()


def test_qos_1_messages_wait_for_a_persistent_session_that_is_away(broker, raw):
    subscriber, publisher = raw(broker), raw(broker)
    assert subscriber.connect("s", clean=False) == 0
    subscriber.subscribe("a", 1)
    subscriber.send(0xE0)
    assert subscriber.is_closed_by_broker()
    publisher.connect("p")
    publisher.publish("a", b"0", 0)
    publisher.publish("a", b"1", 1)
    publisher.publish("a", b"2", 1)
    again = raw(broker)
    assert again.connect("s", clean=False) == 1
    assert [again.read_publish()[3] for _ in range(2)] == [b"1", b"2"]
    again.ping()


def test_unacknowledged_qos_1_message_is_sent_again_with_dup(broker, raw):
    subscriber, publisher = raw(broker), raw(broker)
    subscriber.connect("s", clean=False)
    subscriber.subscribe("a", 1)
    publisher.connect("p")
    publisher.publish("a", b"x", 1)
    publisher.publish("a", b"y", 1)
    _, _, acknowledged, _ = subscriber.read_publish()
    first, _, identifier, _ = subscriber.read_publish()
    assert first == 0x32
    subscriber.send(0x40, acknowledged)
    subscriber.ping()
    subscriber.close()
    again = raw(broker)
    assert again.connect("s", clean=False) == 1
    assert again.read_publish() == (0x3A, "a", identifier, b"y")
    again.send(0x40, identifier)
    again.ping()


def test_clean_connection_forgets_the_persistent_session(broker, raw):
    first, second, third = raw(broker), raw(broker), raw(broker)
    first.connect("s", clean=False)
    first.subscribe("a", 1)
    assert second.connect("s", clean=True) == 0
    assert third.connect("s", clean=False) == 0
    third.publish("a", b"x", 1)
    third.ping()


def test_persistent_session_expires(start_broker, raw, eventually):
    broker = start_broker("--session-expiry-s", "1")
    first = raw(broker)
    first.connect("s", clean=False)
    first.close()

    def is_forgotten() -> bool:
        client = raw(broker)
        present = client.connect("s", clean=False)
        client.close()
        return not present

    # Each look renews the session, so look seldom enough for it to expire in between.
    eventually(lambda: _waited_for_others(broker, raw) and is_forgotten(), "the session is forgotten", 30)


def _waited_for_others(broker, raw) -> bool:
    """Passes the time of two keepalives of a silent client, by the broker's own clock."""
    silent = raw(broker)
    silent.connect("", keepalive_s=2)
    return silent.is_closed_by_broker()
