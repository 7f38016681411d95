"""A short fuzz run against every decoder, and hypothesis against the same promises."""

from __future__ import annotations

import logging
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzz.mutations import mutate
from fuzz.payloads import Tally, fuzz, judge
from fuzz.targets import Target, targets
from jouleswarm.common.errors import PayloadError

TARGETS = targets()
PIECES = tuple(payload for target in TARGETS for payload in target.seeds)
TRIED = 14_000  # 1000 a decoder: a second or two

by_name = pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    logging.disable()
    yield
    logging.disable(logging.NOTSET)


def test_every_spoilt_payload_is_decoded_as_promised_or_refused(tmp_path: Path) -> None:
    outcome = fuzz(TARGETS, TRIED, 7, tmp_path)
    assert [each.crashes for each in outcome.tallies.values()] == [[]] * len(TARGETS)
    assert outcome.is_clean
    assert all(each.accepted and each.refused for each in outcome.tallies.values())


def test_the_same_seed_gives_the_same_payloads() -> None:
    def run() -> list[bytes]:
        rng = random.Random(3)
        return [mutate(rng, PIECES[number % len(PIECES)], PIECES) for number in range(200)]

    assert run() == run()


@by_name
def test_what_is_valid_is_taken(target: Target) -> None:
    for payload in target.seeds:
        for kind in (bytes, bytearray, memoryview):
            target.decode(kind(payload))


@by_name
@settings(deadline=None)  # the first of each decoder loads and warms up
@given(data=st.data())
def test_a_payload_with_any_bytes_in_it_is_decoded_as_promised_or_refused(target: Target, data: st.DataObject) -> None:
    payload = bytearray(data.draw(st.sampled_from(target.seeds)))
    start = data.draw(st.integers(0, len(payload)))
    payload[start : start + data.draw(st.integers(0, 40))] = data.draw(st.binary(max_size=40))
    tally = Tally()
    judge(target, bytes(payload), tally)
    assert tally.crashes == []


def test_the_oracle_finds_another_exception_and_a_broken_promise() -> None:
    def breaks(payload: object) -> None:
        raise KeyError("x")

    def promises(payload: object) -> None:
        raise AssertionError

    def refuses(payload: object) -> None:
        raise PayloadError("no")

    tally = Tally()
    for decode in (breaks, promises, refuses):
        judge(Target("t", (b"",), decode), b"", tally)
    assert (len(tally.crashes), tally.refused, tally.accepted) == (2, 1, 0)
