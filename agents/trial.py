"""A greedy episode: what it counts as the environment judges, and whether the values behind it are any."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import fmean
from typing import Any, NamedTuple

import numpy.typing as npt

from jouleswarm.common.meter.work import Tally
from jouleswarm.environments.environment import TaskEnvironment
from jouleswarm.learning.dqn import ran_away
from jouleswarm.learning.learner import Policy

Array = npt.NDArray[Any]


class Trial(NamedTuple):
    """How a greedy episode went, as the environment judges."""

    reward: float
    measures: dict[str, float]
    motions: int
    ran_away: float | None = None
    """See `learning.dqn.ran_away`."""


def greedy_episode(
    env: TaskEnvironment,
    policy: Policy,
    small: Callable[[Array], Array],
    seed: int | None,
    discount: float,
    tally: Tally,
) -> Trial:
    """One episode of the best action.

    Args:
        env: reset here, with `seed`.
        policy: is asked for values.
        small: what the environment shows, as the policy takes it.
        seed: None goes on with the environment's own noise.
        discount: nu of what it counts.
        tally: counts each motion as it is made.
    """
    observation, total, factor, ended = env.reset(seed=seed), 0.0, 1.0, False
    values: list[float] = []
    rewards: list[float] = []
    while not ended:
        q = policy.q_values(small(observation))
        action = int(q.argmax())
        step = env.step(action)
        tally.evaluation_motion()
        total, factor = total + factor * step.reward, factor * discount
        observation, ended = step.observation, step.ended
        values.append(float(q[action]))
        rewards.append(step.reward)
    return Trial(*env.judge(total), len(rewards), ran_away(values, rewards, discount))


def mean_of(trials: Sequence[Trial]) -> Trial:
    """Means of what episodes count and are measured, the sum of their motions, and values that ran away."""
    names = {name for each in trials for name in each.measures}
    measures = {name: fmean(each.measures[name] for each in trials if name in each.measures) for name in sorted(names)}
    away = max((each.ran_away for each in trials if each.ran_away is not None), default=None)
    return Trial(fmean(each.reward for each in trials), measures, sum(each.motions for each in trials), away)
