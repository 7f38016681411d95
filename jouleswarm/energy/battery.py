"""How many rounds a robot's battery lasts, from facts: the same items as its bill. Pure."""

from __future__ import annotations

import math
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.items import items


class Life(NamedTuple):
    """A robot that begins an arm with a full battery."""

    battery_j: float
    ml_j: float
    """What the stage before took of it."""
    round_j: float
    """Of an average round of its task."""
    rounds: int | None
    """Whole rounds of its task until it is empty; None: no end, for a round takes nothing."""


def lives(facts: Facts, energy: Energy) -> dict[int, Life]:
    """By robot, of those with a battery that did a round of their task; `energy.beta` is a number.

    Raises:
        UnknownFactError: only sums are known of these facts.
        ConfigurationError: a link carried something and is not in the user's table.
    """
    did: dict[int, float] = {}
    for work in facts.work:
        if work.phase == "fl" and work.robot and energy.of(work.robot).battery_j is not None:
            did[work.robot] = did.get(work.robot, 0.0) + work.rounds
    spent = dict.fromkeys(((phase, robot) for phase in ("ml", "fl") for robot in did), 0.0)
    for item in items(facts, energy):
        if item.payer in did:
            spent[item.phase, item.payer] += item.joules
    return {
        robot: _life(energy.of(robot).battery_j or 0.0, spent["ml", robot], spent["fl", robot] / rounds)
        for robot, rounds in sorted(did.items())
        if rounds
    }


def _life(battery_j: float, ml_j: float, round_j: float) -> Life:
    rounds = max(0, math.floor((battery_j - ml_j) / round_j)) if round_j else None
    return Life(battery_j, ml_j, round_j, rounds)
