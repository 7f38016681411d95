"""Made-up facts: the paper's deployment with Table II's own rounds, spread by one round a seed."""

from __future__ import annotations

from typing import Any

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.runs.paper import TABLE_II
from jouleswarm.studies.facts import Fact

SEEDS = (1, 2, 3)
UL_BYTES, W_BYTES = 24_600_000, 5_600_000  # a training robot's round up, a robot's weights: Table I


def task_fact(arm: Arm, task: int, rounds: int, seed: int = 1, variant: str = "", **more: Any) -> Fact:
    """A cluster of two that exchanged its weights in every round."""
    held: dict[str, Any] = {
        "variant": variant, "seed": seed, "arm": arm.name, "method": arm.method, "t0": arm.t0, "task": task,
        "robots": 2, "links": 2, "rounds": rounds, "rounds_first": max(1, rounds - 2), "rounds_w3": rounds,
        "learned": True, "reward": 55.0, "rmse_m": 0.5, "gradients_support": 0, "gradients_query": 0,
        "gradients_robots": 40 * rounds, "uplink_bytes": 0, "downlink_bytes": 0,
        "sidelink_bytes": 2 * W_BYTES * rounds, "sidelink_sent_bytes": 2 * W_BYTES * rounds, "seconds": 1.5 * rounds,
    }  # fmt: skip
    return Fact(**{**held, **more})


def meta_fact(arm: Arm, seed: int = 1, variant: str = "", **more: Any) -> Fact:
    """Three training robots, ten support and ten query batches of each a round; down to twelve robots."""
    held: dict[str, Any] = {
        "robots": 12, "links": 0, "rounds_first": arm.t0, "reward": None, "rmse_m": None, "gradients_robots": 0,
        "gradients_support": 30 * arm.t0, "gradients_query": 30 * arm.t0, "uplink_bytes": 3 * UL_BYTES * arm.t0,
        "downlink_bytes": 12 * W_BYTES, "sidelink_bytes": 0, "sidelink_sent_bytes": 0,
    }  # fmt: skip
    return task_fact(arm, 0, arm.t0, seed, variant, **{**held, **more})


def pair_of_arms(variant: str, seed: int, with_meta: int, without: int) -> list[Fact]:
    """t0 = 42 and the given rounds for each of the six tasks, with meta-learning and without."""
    maml, plain = Arm("maml", "maml", 42), Arm("fl", "fl", 0)
    return [
        meta_fact(maml, seed, variant),
        *(task_fact(maml, task, with_meta + task, seed, variant) for task in range(1, 7)),
        *(task_fact(plain, task, without + task, seed, variant) for task in range(1, 7)),
    ]


def paper_facts() -> list[Fact]:
    facts = []
    for seed in SEEDS:
        for t0, rounds in TABLE_II.items():
            arm = Arm("fl", "fl", 0) if t0 == 0 else Arm("maml" if t0 == 240 else f"maml-t{t0}", "maml", t0)
            if t0:
                facts.append(meta_fact(arm, seed))
            for task, mean in enumerate(rounds, start=1):
                learned = (seed, t0, task) != (3, 0, 1)
                facts.append(task_fact(arm, task, round(mean) + seed, seed, learned=learned))
    return facts
