"""Rounds that are waited for: what has come of them, from whom it is missing, what came twice or cannot be yet."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, Generic, TypeVar

from jouleswarm.common.disk.state import State
from jouleswarm.common.errors import PayloadError

T = TypeVar("T")
AHEAD = 2
"""Who has said its word of a round can be in the next one while others gather it: so far from the last one taken."""


class Rounds(Generic[T]):
    """Of senders that each send so many messages a round. Holds no more than `AHEAD` rounds; knows of no bus."""

    def __init__(
        self,
        senders: Iterable[int],
        opened: Callable[[int, list[Any]], T],
        refused: Callable[[str, PayloadError], None],
        messages: Callable[[int], int] = lambda sender: 1,
        until: float = math.inf,
    ) -> None:
        """
        Args:
            senders: who sends.
            opened: what a sender's messages of a round come to. Called once for each round, in the order of rounds.
            refused: told of what does not open; it is missing then, as if it had not come.
            messages: how many a sender sends in a round, numbered from 0.
            until: the last round that there is.
        """
        self._messages = {sender: messages(sender) for sender in senders}
        self._opened, self._refused, self._until = opened, refused, until
        self._held: dict[int, dict[int, dict[int, Any]]] = {}  # round -> sender -> place -> message
        self._open: dict[int, T] = {}  # of the round after `done`
        self.done = 0
        """The newest round that was taken."""

    @property
    def last(self) -> float:
        """The newest round that anybody may be in."""
        return min(self.done + AHEAD, self._until)

    def put(self, round_: int, sender: int, message: Any, place: int = 0) -> bool:
        """Keep what has come; False: it had come before.

        Raises:
            PayloadError: of a round or place that its sender cannot be at.
        """
        if round_ <= self.done:
            return False
        messages = self._messages.get(sender, 0)
        if round_ > self.last or not 0 <= place < messages:
            raise PayloadError(
                f"round {round_}, message {place} of robot {sender}; expected rounds up to {self.last} and messages "
                f"below {messages}"
            )
        held = self._held.setdefault(round_, {}).setdefault(sender, {})
        is_new = place not in held
        held.setdefault(place, message)
        return is_new

    def has_of(self, sender: int, round_: int) -> bool:
        """Whether anything of a sender's round, or a later one, has come."""
        return any(sender in held for number, held in self._held.items() if number >= round_)

    def missing(self) -> list[int]:
        """Senders of whom not all of the round after `done` has come."""
        held = self._held.get(self.done + 1, {})
        for sender in [sender for sender in held if sender not in self._open]:
            if len(held[sender]) == self._messages[sender]:
                try:
                    self._open[sender] = self._opened(sender, [part for _, part in sorted(held[sender].items())])
                except PayloadError as error:
                    del held[sender]
                    self._refused(f"round {self.done + 1} of robot {sender}", error)
        return [sender for sender in self._messages if sender not in self._open]

    def take(self) -> dict[int, T]:
        """What has come whole of the round after `done`, which it is from here on."""
        opened = self._open
        self.go_to(self.done + 1)
        return opened

    def state(self) -> State:
        """How far they are: what had come of later ones is asked for again."""
        return State(values={"done": self.done})

    def load_state(self, state: State) -> None:
        self.go_to(state.values["done"])

    def go_to(self, done: int) -> None:
        """Be done with all rounds up to this one."""
        if done != self.done:
            self.done, self._open = done, {}
            self._held = {round_: held for round_, held in self._held.items() if round_ > done}

    def clear(self, done: int) -> None:
        """The same, and forget what has come of later ones."""
        self.done, self._open, self._held = done, {}, {}
