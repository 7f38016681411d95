"""Logins that fail too often: the rule by a clock of our own, then on a real broker."""

from __future__ import annotations

import pytest

from jouleswarm.broker.attempts import ADDRESSES, AT_ONCE, EVERY_S, Attempts, source_of
from jouleswarm.common.bus.credentials import credentials_of


@pytest.fixture
def failed() -> Attempts:
    """The address `a` has failed as often as it may at once, at 100 s."""
    attempts = Attempts()
    for _ in range(AT_ONCE):
        assert not attempts.must_wait("a", 100)
        attempts.failed("a", 100)
    return attempts


def test_after_ten_failures_the_next_login_is_looked_at_in_five_seconds_and_then_each_five(failed):
    assert (AT_ONCE, EVERY_S) == (10, 5)
    assert [failed.must_wait("a", now_s) for now_s in (100, 104, 105)] == [True, True, False]
    failed.failed("a", 105)
    assert [failed.must_wait("a", now_s) for now_s in (105, 109, 110)] == [True, True, False]


def test_all_ten_are_free_again_after_fifty_seconds(failed):
    for _ in range(AT_ONCE):
        assert not failed.must_wait("a", 150)
        failed.failed("a", 150)
    assert failed.must_wait("a", 150)


def test_no_other_address_waits(failed):
    assert not failed.must_wait("b", 100)


def test_of_too_many_addresses_the_one_that_failed_longest_ago_is_forgotten(failed):
    for number in range(ADDRESSES - 1):
        failed.failed(f"other {number}", 101)
    assert failed.must_wait("a", 101)
    failed.failed("one more", 101)
    assert not failed.must_wait("a", 101)


@pytest.mark.parametrize(
    ("host", "source"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
    ],
)
def test_an_address_is_that_of_ipv4_or_64_bits_of_ipv6(host, source):
    assert source_of(host) == source


def test_who_fails_too_often_is_not_looked_at_and_slows_neither_known_users_nor_other_addresses(guarded, raw, keys):
    def answer(user: str, password: str | None = None, source: str = "127.0.0.1") -> int:
        """The code of CONNACK."""
        own = credentials_of(keys, user)
        return raw(guarded, own.context(), source).log_in(user, password or own.password)

    assert answer("agent-2") == 0
    assert [answer("agent-1", "guess") for _ in range(AT_ONCE)] == [4] * AT_ONCE
    assert answer("agent-1", "guess") == 3  # server unavailable: it may try again
    assert answer("agent-1") == 3
    assert answer("agent-2") == 0  # has shown its password before
    assert answer("agent-1", source="127.0.0.2") == 0
    guarded.counted("refused_not_authorized", AT_ONCE)
    guarded.counted("refused_too_often", 2)
