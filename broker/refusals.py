"""The newest refusals as text, for whoever wants to know why something does not arrive."""

from __future__ import annotations

KEPT = 20
LINE_LENGTH = 500


def shortened(text: str) -> str:
    """`text`, cut where a client has made it long."""
    return text if len(text) <= LINE_LENGTH else text[: LINE_LENGTH - 3] + "..."


class Refusals:
    """What was refused, each text once with how often, the newest last."""

    def __init__(self) -> None:
        self._times: dict[str, int] = {}

    def add(self, text: str) -> None:
        """One more; the one that has not happened for longest makes room."""
        text = shortened(text)
        self._times[text] = self._times.pop(text, 0) + 1
        if len(self._times) > KEPT:
            del self._times[next(iter(self._times))]

    def lines(self) -> tuple[str, ...]:
        """One line each."""
        return tuple(text if times == 1 else f"{text} ({times} times)" for text, times in self._times.items())
