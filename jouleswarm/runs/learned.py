"""In which round a task counts as learned, by each measure, and how the episodes went that say so. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Federation
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.methods.graph import neighbourhood_of


def is_learned(settings: Federation, row: RoundRow) -> bool:
    """Whether a robot's last row says so; of a run that was cut off by R and its window."""
    if row.learned is not None:
        return row.learned
    is_full = not row.round or row.round >= settings.reward_window or settings.window == "partial"
    return is_full and _reached(settings, row)


def rounds_by(scenario: Scenario, rows: Sequence[RoundRow], partners: str, *, full: bool) -> int | None:
    """t_i by the rows of a task's robots in an arm: when the last of them knew R at the target; None: not by the end.

    Args:
        scenario, rows: also of a run that was made by the other measure, as far as it went.
        partners: whom the robots meet; where neighbours pass R on, it is known some rounds later.
        full: by a whole window of rounds alone, or by round 0; else in earlier rounds by those that there are.
    """
    settings, found = scenario.federation, []
    for agent in sorted({row.agent for row in rows}):
        lag = neighbourhood_of(scenario, agent, partners).diameter - 1
        first = settings.reward_window + lag if full else 1
        mine = [row.round for row in rows if row.agent == agent and _reached(settings, row)]
        found.append(min((round_ for round_ in mine if not round_ or round_ >= first), default=None))
    told = [each for each in found if each is not None]
    return max(told) if told and len(told) == len(found) else None


def missed_exits(settings: Federation, rows: Sequence[RoundRow], newest: Mapping[int, RoundRow]) -> tuple[int, int]:
    """How many of the episodes that R is of missed their end, and how many tell: those whose rows measure `reached`.

    `newest`: each robot's last row.
    """
    missed = episodes = 0
    for row in rows:
        last, reached = newest[row.agent].round, row.measures.get("reached")
        if reached is not None and (row.round == last == 0 or 0 < row.round > last - settings.reward_window):
            count = 1 if row.round else settings.reward_window
            missed, episodes = missed + round((1 - reached) * count), episodes + count
    return missed, episodes


def _reached(settings: Federation, row: RoundRow) -> bool:
    return row.cluster_reward is not None and row.cluster_reward >= settings.target_reward
