"""Who is waited for: everybody, or with `on_missing = "proceed"` those who are there."""

import pytest

from jouleswarm.agents import absence
from jouleswarm.agents.absence import Absence
from jouleswarm.common.scenario.sections import Federation


class Clock:
    """In place of the module `time`."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(absence, "time", clock)
    return clock


def proceed() -> Absence:
    return Absence(Federation(on_missing="proceed", missing_after_s=30.0))


def test_by_default_the_gone_and_the_late_are_waited_for(clock: Clock) -> None:
    patient = Absence(Federation())
    patient.begin()
    patient.gone(2)
    clock.now_s += 1e6
    assert patient.waited_for([2, 3]) == [2, 3]


def test_who_is_gone_is_not_waited_for_until_it_is_there_again(clock: Clock) -> None:
    here = proceed()
    here.begin()
    here.gone(2)
    assert here.waited_for([2, 3]) == [3]
    here.here(2)
    assert here.waited_for([2, 3]) == [2, 3]


def test_who_is_late_is_waited_for_until_the_deadline_and_once_only(clock: Clock) -> None:
    here = proceed()
    here.begin()
    clock.now_s += 29.9
    assert here.waited_for([2]) == [2]
    clock.now_s += 0.1
    assert here.waited_for([2]) == []
    here.begin()  # the next round
    assert here.waited_for([2]) == []
    here.here(2)
    assert here.waited_for([2]) == [2]


def test_the_deadline_runs_from_the_beginning_of_each_round(clock: Clock) -> None:
    here = proceed()
    here.begin()
    clock.now_s += 20
    here.begin()
    clock.now_s += 20
    assert here.waited_for([3]) == [3]
