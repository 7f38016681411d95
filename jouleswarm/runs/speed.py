"""How fast this machine is at a scenario's batch gradients and motions: a quick timing, for an estimate."""

from __future__ import annotations

import os
import resource
import time
from typing import NamedTuple

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.environment import TaskEnvironment
from jouleswarm.runs.foretold import foretold_facts

_GRADIENTS, _MOTIONS = 5, 20


class Speed(NamedTuple):
    """Processor time of one thread."""

    gradient_s: float
    motion_s: float
    """With the network's answer to what is seen."""
    process_bytes: float
    """What a process with PyTorch has at its fullest here, shared pages too."""
    has_guide: bool
    """Whether the environment that was timed knows a policy."""


def measure_speed(scenario: Scenario) -> Speed:
    """Time a few gradients and motions of the first task; takes a second or two, most of it PyTorch's start."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        return _measured(scenario)
    finally:
        torch.set_num_threads(threads)


def _measured(scenario: Scenario) -> Speed:
    import numpy as np

    from jouleswarm.codecs.frames import shrink
    from jouleswarm.learning.learner import Learner
    from jouleswarm.learning.networks import build_qnetwork, to_weights

    network, rng = build_qnetwork(scenario, 0), np.random.default_rng(0)
    learner = Learner(network, scenario.learning.model_copy(update={"replay_size": 100}), to_weights(network), rng)
    environment = TaskEnvironment(scenario, scenario.tasks[0].id)
    environment.show(kept := scenario.spaces.observation.kept(scenario.network))
    frame, began = environment.reset(seed=1), 0.0
    for motion in range(-3, _MOTIONS):
        if motion == 0:
            began = time.process_time()
        seen = shrink(frame, kept)
        learner.replay.observe(seen, first=motion == -3)
        learner.q_values(seen)
        step = environment.step(int(rng.integers(len(scenario.spaces.actions))))
        learner.replay.act(0, step.reward, terminated=False)
        frame = environment.reset() if step.ended else step.observation
    motion_s = (time.process_time() - began) / _MOTIONS
    learner.learn(2)
    began = time.process_time()
    learner.learn(_GRADIENTS)
    gradient_s = (time.process_time() - began) / _GRADIENTS
    process_bytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return Speed(gradient_s, motion_s, process_bytes, environment.has_guide)


def estimated_s(scenario: Scenario, speed: Speed, rounds: float) -> float:
    """Seconds of the whole if each task takes `rounds` rounds: gradients and motions over this machine's cores, a
    greedy episode taken to be as long as a round's motions; starts and waits are not in it."""
    done, stages = 0.0, set[str]()
    for arm in sorted(scenario.arms, key=lambda arm: -arm.t0):  # of arms that share a stage the longest has it
        facts = foretold_facts(scenario, arm, 0 if arm.method in stages else arm.t0, rounds)
        stages.add(arm.method)
        for work in facts.work:
            motions = work.motions * (2 if work.phase == "fl" else 1)
            done += (work.plain + work.exact) * speed.gradient_s + motions * speed.motion_s
    return done / min(len(os.sched_getaffinity(0)), len(scenario.agents))
