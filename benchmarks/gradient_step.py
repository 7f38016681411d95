"""A robot's gradient step beside the same by autograd and in a bare PyTorch loop, and what is arithmetic; one thread.

    python -m benchmarks.gradient_step [--scenarios paper quick] [--repeats 7]

All sides: double DQN targets, Huber loss, gradient clipping, fused Adam, target tracking, batch of 32. The
bare loop has its batches ready as tensors; the others draw and convert them from replay. "by autograd" is the robot's
step as it was before it went by hand and over all parameters as one. Processor time, so that it does not matter what
else the machine does. The arithmetic is what the robot's step spends inside the kernels of convolutions and matrix
products (oneDNN and MKL), as PyTorch's profiler sees it: nothing around them can save more than the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import torch
from torch import nn
from torch.profiler import ProfilerActivity, profile

from benchmarks.harness import compare, cpu_seconds, in_turn, parser
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.learning.dqn import polyak_update, td_loss, td_target
from jouleswarm.learning.learner import Learner
from jouleswarm.learning.networks import build_qnetwork, to_weights
from jouleswarm.learning.replay import Replay
from jouleswarm.learning.task_loss import TensorBatch, to_tensors

STEPS = 10
Batches = Callable[[], Iterator[TensorBatch]]
_KERNELS = ("aten::mkldnn_convolution", "aten::convolution_backward", "aten::addmm", "aten::mm")


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--scenarios", nargs="+", default=["paper", "quick"])
    known.add_argument("--repeats", type=int, default=7)
    options = known.parse_args()
    use_one_thread()
    for name in options.scenarios:
        scenario = load_scenario(name)
        robot = _robot(scenario)
        others = {"by autograd": _loop(scenario, _drawn(scenario)), "bare loop": bare_loop(scenario)}
        sides = {"robot": robot, **others}
        found = in_turn({side: partial(cpu_seconds, steps) for side, steps in sides.items()}, options.repeats)
        for other in others:
            pair = {side: found[side] for side in ("robot", other)}
            print(compare(f"a step of {name}", pair, factor=1e3 / STEPS))
        print(f"in the kernels of convolutions and matrix products: {arithmetic_share(robot):.0%} of the robot's step")


def arithmetic_share(steps: Callable[[], None]) -> float:
    """What share of the time the kernels take."""
    with profile(activities=[ProfilerActivity.CPU]) as seen:
        steps()
    spent = {each.key: each.self_cpu_time_total for each in seen.key_averages()}
    return sum(spent.get(name, 0.0) for name in _KERNELS) / sum(spent.values())


def _robot(scenario: Scenario) -> Callable[[], None]:
    network = build_qnetwork(scenario, 0)
    learner = Learner(network, scenario.learning, to_weights(network), np.random.default_rng(0))
    _remember(learner.replay, network.takes.shape)

    def steps() -> None:
        learner.learn(STEPS)

    return steps


def _remember(replay: Replay, shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    for index in range(200):
        replay.observe(rng.integers(0, 256, shape, dtype=np.uint8), first=index == 0)
        replay.act(int(rng.integers(4)), -1.0, terminated=False)


def _drawn(scenario: Scenario) -> Batches:
    network, rng = build_qnetwork(scenario, 0), np.random.default_rng(0)
    replay = Replay(scenario.learning.replay_size, network.takes)
    _remember(replay, network.takes.shape)

    def batches() -> Iterator[TensorBatch]:
        for _ in range(STEPS):
            yield to_tensors(replay.sample(scenario.learning.batch_size, rng), network, torch.device("cpu"))

    return batches


def _ready(scenario: Scenario) -> Batches:
    held = list(_drawn(scenario)())
    return lambda: iter(held)


def bare_loop(scenario: Scenario) -> Callable[[], None]:
    """The step in a loop of its own, its batches ready as tensors."""
    return _loop(scenario, _ready(scenario))


def _loop(scenario: Scenario, batches: Batches) -> Callable[[], None]:
    settings = scenario.learning
    online, target = build_qnetwork(scenario, 0), build_qnetwork(scenario, 0).requires_grad_(False)
    parameters, tracked = list(online.parameters()), list(target.parameters())
    optimizer = torch.optim.Adam(parameters, lr=settings.lr, eps=settings.adam_eps, fused=True)

    def steps() -> None:
        for batch in batches():
            with torch.no_grad():
                next_q, next_q_target = online(batch.next_frames), target(batch.next_frames)
                told = (batch.rewards, batch.terminated, next_q, next_q_target, settings.discount)
                goal = td_target(*told, double=True)
            loss = td_loss(online(batch.frames), batch.actions, goal)
            optimizer.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(parameters, settings.grad_clip, foreach=True)
            optimizer.step()
            polyak_update(tracked, parameters, settings.target_polyak)

    return steps


if __name__ == "__main__":
    main()
