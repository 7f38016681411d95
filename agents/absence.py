"""Which neighbours are not waited for: `federation.on_missing`."""

from __future__ import annotations

import time
from collections.abc import Sequence

from jouleswarm.common.scenario.sections import Federation


class Absence:
    """Who is excused from a round. With `wait`, the default, nobody ever is: the run does not depend on timing."""

    def __init__(self, settings: Federation) -> None:
        self.is_tolerated = settings.on_missing == "proceed"
        self._after_s = settings.missing_after_s
        self._gone: set[int] = set()
        self._since_s = 0.0

    def gone(self, agent: int) -> None:
        """A neighbour's connection broke off; it is not waited for until it is heard of again."""
        self._gone.add(agent)

    def here(self, agent: int) -> None:
        """A neighbour is there, or is there again."""
        self._gone.discard(agent)

    def begin(self) -> None:
        """From now on neighbours are waited for."""
        self._since_s = time.monotonic()

    def waited_for(self, missing: Sequence[int]) -> list[int]:
        """Those of the missing without whom it does not go on. For one of them it is waited once, not every round."""
        if not self.is_tolerated:
            return list(missing)
        if time.monotonic() - self._since_s >= self._after_s:
            self._gone.update(missing)
        return [agent for agent in missing if agent not in self._gone]
