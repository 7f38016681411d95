"""What has come of a round, what is missing, what came twice, what cannot be yet."""

from __future__ import annotations

import pytest

from jouleswarm.common.bus.rounds import Rounds
from jouleswarm.common.errors import PayloadError


class Told:
    """Rounds of robots 2 (one message a round) and 3 (two), which open as their sum, unless that is below 0."""

    def __init__(self, until: float = 9) -> None:
        self.refused: list[str] = []
        self.opened: list[int] = []
        self.rounds = Rounds(
            (2, 3), self._open, lambda what, _: self.refused.append(what), lambda each: each - 1, until
        )

    def _refuse(self, what: str, _: PayloadError) -> None:
        self.refused.append(what)

    def _open(self, sender: int, parts: list[int]) -> int:
        if sum(parts) < 0:
            raise PayloadError("below 0")
        self.opened.append(sender)
        return sum(parts)


def test_a_round_is_whole_when_all_messages_of_all_have_come_whatever_their_order() -> None:
    told = Told()
    assert told.rounds.missing() == [2, 3]
    assert told.rounds.put(1, 3, 30, place=1)
    assert told.rounds.put(1, 2, 20)
    assert told.rounds.missing() == [3]
    assert told.rounds.put(1, 3, 31, place=0)
    assert told.rounds.missing() == []
    assert (told.rounds.take(), told.rounds.done) == ({2: 20, 3: 61}, 1)
    assert told.rounds.missing() == [2, 3]


def test_what_comes_again_is_not_new_and_changes_nothing() -> None:
    told = Told()
    assert [told.rounds.put(1, 2, value) for value in (20, 99)] == [True, False]
    assert told.rounds.missing() == [3]
    assert told.rounds.take() == {2: 20}  # 3 is left out
    assert not told.rounds.put(1, 2, 20)
    assert not told.rounds.put(1, 3, 30)


def test_the_round_after_is_kept_and_opened_in_its_turn() -> None:
    told = Told()
    told.rounds.put(2, 2, 22)
    assert (told.rounds.missing(), told.opened) == ([2, 3], [])
    assert (told.rounds.has_of(2, 1), told.rounds.has_of(2, 2), told.rounds.has_of(2, 3)) == (True, True, False)
    told.rounds.put(1, 2, 21)
    assert told.rounds.missing() == [3]
    assert told.rounds.take() == {2: 21}
    assert told.rounds.missing() == [3]
    assert told.rounds.take() == {2: 22}


@pytest.mark.parametrize(("round_", "sender", "place"), [(3, 2, 0), (1, 2, 1), (1, 3, 2), (1, 3, -1), (1, 7, 0)])
def test_a_round_or_place_that_its_sender_cannot_be_at_is_refused(round_: int, sender: int, place: int) -> None:
    told = Told()
    told.rounds.put(2, 2, 22)
    with pytest.raises(PayloadError, match=f"message {place} of robot {sender}; expected rounds up to 2"):
        told.rounds.put(round_, sender, 0, place)


def test_there_is_no_round_after_the_last_one() -> None:
    told = Told(until=1)
    with pytest.raises(PayloadError, match="expected rounds up to 1"):
        told.rounds.put(2, 2, 22)


def test_what_does_not_open_is_told_once_and_missing_until_it_comes_anew() -> None:
    told = Told()
    told.rounds.put(1, 2, -20)
    assert told.rounds.missing() == told.rounds.missing() == [2, 3]
    assert told.refused == ["round 1 of robot 2"]
    assert told.rounds.put(1, 2, 20)
    assert told.rounds.missing() == [3]


def test_who_is_back_or_has_caught_up_begins_with_the_round_after() -> None:
    told = Told()
    told.rounds.put(1, 2, 21)
    told.rounds.put(2, 2, 22)
    told.rounds.go_to(1)
    assert told.rounds.missing() == [3]
    told.rounds.clear(5)
    assert (told.rounds.missing(), told.rounds.done) == ([2, 3], 5)
    assert told.rounds.put(7, 2, 27)
