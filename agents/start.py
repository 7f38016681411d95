"""Round 0: before its first round of an arm each robot tries the model that it starts from.

All robots of a cluster hold the same model then. R is the mean over them of as many greedy episodes as its window has;
where it reaches the target the task is learned in no round: nothing goes over a link, and what is handed in is the
model that they began with. What each is rewarded goes round by presence, on the control link, and is kept before it is
told: all decide by the same numbers, whatever the network does, and if an episode would go otherwise a second time too.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import fmean
from typing import Any

from jouleswarm.agents.trial import mean_of
from jouleswarm.agents.ways import Here, Way
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.rows import measured
from jouleswarm.common.wire.types import Weights


def begin(here: Here, way: Way, keep: Callable[[], None]) -> tuple[dict[str, Any], tuple[Weights, ModelHeader]]:
    """Do round 0: what its row tells, and the model as it is handed in if the task is learned.

    Args:
        here, way: the robot in the arm, and what acts.
        keep: writes the robot's state; called before others are told anything.
    """
    exchange, settings = here.exchange, here.scenario.federation
    trials = here.explorer.evaluate_at_start(way.policy, settings.reward_window)
    mean = mean_of(trials)
    exchange.at_start.setdefault(here.agent, mean.reward)
    keep()
    exchange.await_start()
    known = exchange.at_start
    exchange.missed = tuple(each for each in exchange.here.neighbours if each not in known)
    cluster_reward = fmean(known[agent] for agent in sorted(known))
    told = {
        "reward": mean.reward,
        "cluster_reward": cluster_reward,
        **measured(mean.measures),
        "motions": 0,
        "evaluation_motions": mean.motions,
        "ran_away": mean.ran_away,
        "learned": True if cluster_reward >= settings.target_reward else None,
        "missed": exchange.missed,
    }
    header = ModelHeader(
        task=exchange.here.task,
        agent=here.agent,
        round=0,
        reward=cluster_reward,
        rewards={here.agent: (0, trials[-1].reward)},
    )
    return told, (way.policy.weights(), header)
