"""The robot's loop where the data center learns: move -> send up -> take the model -> evaluate -> decide."""

from __future__ import annotations

import time

from jouleswarm.agents.explorer import Explorer
from jouleswarm.agents.memory import Memory
from jouleswarm.agents.peers import Exchange
from jouleswarm.agents.served import ServerLink
from jouleswarm.common.disk.state import Stateful
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import Episode, ModelHeader
from jouleswarm.common.wire.rows import RoundRow, measured
from jouleswarm.common.wire.saved_models import encode_saved_model
from jouleswarm.learning.learner import Policy, Weights
from jouleswarm.learning.networks import build_qnetwork, use_of
from jouleswarm.methods.ledger import RewardLedger


def follow(
    scenario: Scenario, arm: Arm, weights: Weights, exchange: Exchange, explorer: Explorer, memory: Memory
) -> None:
    """Act by the data center's model and report how it does, until the cluster's R reaches the target."""
    here, settings = exchange.here, scenario.federation
    link = ServerLink(exchange)
    link.hear_episodes()
    policy = Policy(build_qnetwork(scenario), weights)
    ledger = RewardLedger(here.cluster, 1, settings.reward_window)
    explorer.begin(arm.name, here.cluster)
    kept: dict[str, Stateful] = {
        "policy": policy,
        "explorer": explorer,
        "ledger": ledger,
        "link": link,
        "exchange": exchange,
    }
    done = memory.restore(arm.name, kept)
    for round_ in range(done + 1, settings.max_rounds + 1):
        begun = time.monotonic()
        for payload in explorer.policy_motions(policy, round_):
            link.publish_motion(round_, payload)
        policy.set_weights(link.await_model(round_)[0])
        reward, measures = explorer.evaluate(policy)

        link.publish_episode(Episode(agent=here.agent, round=round_, reward=reward))
        for agent, theirs in {here.agent: reward, **link.await_episodes(round_)}.items():
            ledger.record(agent, round_, theirs)
        cluster_reward = ledger.cluster_reward(round_)
        learned = cluster_reward is not None and cluster_reward >= settings.target_reward
        last = learned or round_ == settings.max_rounds
        exchange.report(
            RoundRow(
                phase="fl",
                arm=arm.name,
                task=here.task,
                agent=here.agent,
                round=round_,
                reward=reward,
                cluster_reward=cluster_reward,
                learned=learned if last else None,
                refused=exchange.refused,
                seconds=round(time.monotonic() - begun, 4),
                **measured(measures),
            )
        )
        if last:
            break
        memory.save(arm.name, round_, kept)
    if here.agent == min(here.cluster):
        header = ModelHeader(
            task=here.task, agent=here.agent, round=round_, reward=cluster_reward, rewards=ledger.newest()
        )
        use = use_of(scenario)
        exchange.hand_in(encode_saved_model(policy.weights(), header, use, explorer.evaluation))
    memory.save(arm.name, round_, {"exchange": exchange}, ended=True)
