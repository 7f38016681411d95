"""All processes of a run have one scenario: who comes with another one is refused, and those that were there go on."""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import decode_json, encode_json

_MAX_BYTES = 16 * 1024 * 1024
_SHOWN = 5
_ABSENT = object()


class Proclamation(BaseModel):
    """What a run's processes must have in common, as the first of them has it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    who: str = Field(max_length=100, description="random name of the process")
    terms: dict[str, Any] | None = Field(description="none: asks whether there are any")


def proclamation(scenario: Scenario, who: str = topics.RECORDER) -> bytes:
    """A scenario as it is told to others."""
    return encode_json(Proclamation(who=who, terms=terms(scenario)))


class Agreement:
    """A process's part in it.

    What the recorder proclaims is the run's scenario; without a recorder what a process proclaimed first, in the
    broker's order. Both are retained, so that who comes later hears of it.
    """

    def __init__(self, listener: Listener, scenario: Scenario, run: str) -> None:
        self._listener, self._bus = listener, listener.bus
        self._who, self._terms = secrets.token_hex(8), terms(scenario)
        self._topic, self._recorders = topics.scenario(run, topics.SHARED), topics.scenario(run, topics.RECORDER)
        self._said = proclamation(scenario, self._who)
        self._answered = self._is_settled = self._holds = False
        self._first: Proclamation | None = None
        self._recorded: Proclamation | None = None
        self.filters = [self._topic, self._recorders]

    def settle(self) -> None:
        """Find out what the run's scenario is, or say so as the first one.

        Raises:
            ConfigurationError: it is another than this process's; the bus has been closed.
        """
        self._listener.handlers["scenario"] = self._take
        self._bus.subscribe(*self.filters)
        # What is retained comes before the echo of what is asked after subscribing.
        self._until(lambda: self._answered, encode_json(Proclamation(who=self._who, terms=None)), retain=False)
        if not (self._recorded or self._first):
            self._until(lambda: bool(self._recorded or self._first), self._said, retain=True)
        found = self._recorded or self._first
        assert found is not None
        if refusal := self._refusal(found):
            if self._recorded is None:  # it may have been overwritten from here
                self._bus.publish(self._topic, encode_json(found), retain=True)
            self._bus.close()
            raise refusal
        self._is_settled, self._holds = True, found.who == self._who

    def leave(self) -> None:
        """The run is over for this process: clear what it proclaimed."""
        if self._holds:
            self._holds = False
            self._bus.publish(self._topic, b"", retain=True)

    def _until(self, condition: Callable[[], bool], said: bytes, *, retain: bool) -> None:
        def say() -> None:
            self._bus.publish(self._topic, said, retain=retain)

        say()
        self._listener.until(condition, lambda: "the broker", say)

    def _take(self, message: Message) -> None:
        if not message.payload:
            return
        said = decode_json(message.payload, Proclamation, _MAX_BYTES)
        if message.topic == self._recorders:
            self._recorded = said
            if self._is_settled and (refusal := self._refusal(said)):
                raise refusal
        elif said.terms is None:
            self._answered = self._answered or said.who == self._who
        elif self._first is None:
            self._first = said
        elif self._holds and said.terms != self._terms:  # of one that was refused, for who comes next
            self._bus.publish(self._topic, self._said, retain=True)

    def _refusal(self, found: Proclamation) -> ConfigurationError | None:
        told = list(differences(self._terms, found.terms or {}))
        if not told:
            return None
        more = f"; and {len(told) - _SHOWN} more" if len(told) > _SHOWN else ""
        whose = "the recorder's" if found is self._recorded else "that of the process that came first"
        return ConfigurationError(
            f"another scenario than the run's: {'; '.join(told[:_SHOWN])}{more}; expected {whose}: use its file and "
            "--set options, or another --run (a recorder replaces what an earlier run by this name has left)"
        )


def terms(scenario: Scenario) -> dict[str, Any]:
    """All that results depend on, flat: section.key -> plain value. Not the name, prices, and how long to wait."""
    data = scenario.model_dump(mode="json", exclude={"name": True})
    data["energy"] = {"beta": data["energy"]["beta"]}  # a measured one is the data center's work
    data["bus"] = {"qos": data["bus"]["qos"]}
    del data["federation"]["give_up_after_s"]
    data["doors"] = scenario.learned_by
    return dict(_flat(data, ""))


def differences(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> Iterator[str]:
    """Each key that differs, with both values."""
    for key in {**ours, **theirs}:
        here, there = ours.get(key, _ABSENT), theirs.get(key, _ABSENT)
        if here is _ABSENT or there is _ABSENT or here != there:
            yield f"{key[:80]} is {_short(here)} here and {_short(there)} there"


def _flat(value: Any, where: str) -> Iterator[tuple[str, Any]]:
    """Leaves of nested sections; in a list of tasks each has its place."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from _flat(each, f"{where}.{key}".removeprefix("."))
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for place, each in enumerate(value):
            yield from _flat(each, f"{where}.{place}")
    else:
        yield where, value


def _short(value: object) -> str:
    text = "not there" if value is _ABSENT else json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
