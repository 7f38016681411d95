"""A robot's gradient step beside the same step in a bare PyTorch loop, and what of it is arithmetic; one thread.

    python -m benchmarks.gradient_step [--scenarios paper quick] [--repeats 7]

Both sides: double DQN targets, Huber loss, gradient clipping, fused Adam, target tracking, batch of 32. The
bare loop has its batches ready as tensors; the robot draws and converts them from replay. Processor time, so that it
does not matter what else the machine does. The arithmetic is what the robot's step spends inside the kernels of
convolutions and matrix products (oneDNN and MKL), as PyTorch's profiler sees it: nothing around them can save more than
the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from torch import nn
from torch.nn import functional
from torch.profiler import ProfilerActivity, profile

from benchmarks.harness import compare, cpu_seconds, in_turn, parser
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.learning.learner import Learner
from jouleswarm.learning.networks import build_qnetwork, to_weights

STEPS = 10
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
        sides = {"robot": partial(cpu_seconds, robot), "bare loop": partial(cpu_seconds, bare_loop(scenario))}
        print(compare(f"a step of {name}", in_turn(sides, options.repeats), factor=1e3 / STEPS))
        print(f"in the kernels of convolutions and matrix products: {arithmetic_share(robot):.0%} of the robot's step")


def arithmetic_share(steps: Callable[[], None]) -> float:
    """What share of the time the kernels take."""
    with profile(activities=[ProfilerActivity.CPU]) as seen:
        steps()
    spent = {each.key: each.self_cpu_time_total for each in seen.key_averages()}
    return sum(spent.get(name, 0.0) for name in _KERNELS) / sum(spent.values())


def _robot(scenario: Scenario) -> Callable[[], None]:
    rng, network = np.random.default_rng(0), build_qnetwork(scenario, 0)
    learner = Learner(network, scenario.learning, to_weights(network), rng)
    for index in range(200):
        frame = rng.integers(0, 256, network.takes.shape, dtype=np.uint8)
        learner.replay.observe(frame, first=index == 0)
        learner.replay.act(int(rng.integers(4)), -1.0, terminated=False)

    def steps() -> None:
        learner.learn(STEPS)

    return steps


def bare_loop(scenario: Scenario) -> Callable[[], None]:
    rng, settings = np.random.default_rng(0), scenario.learning
    online, target = build_qnetwork(scenario, 0), build_qnetwork(scenario, 0).requires_grad_(False)
    parameters, tracked = list(online.parameters()), list(target.parameters())
    optimizer = torch.optim.Adam(parameters, lr=settings.lr, fused=True)
    shape = (settings.batch_size, *online.takes.shape)
    batches = [
        (
            online.prepare(rng.integers(0, 256, shape, dtype=np.uint8)),
            torch.from_numpy(rng.integers(4, size=settings.batch_size)),
            torch.full((settings.batch_size,), -1.0),
            online.prepare(rng.integers(0, 256, shape, dtype=np.uint8)),
        )
        for _ in range(STEPS)
    ]

    def steps() -> None:
        for frames, actions, rewards, next_frames in batches:
            with torch.no_grad():
                best = online(next_frames).argmax(1, keepdim=True)
                goal = rewards + settings.discount * target(next_frames).gather(1, best).squeeze(1)
            q = online(frames).gather(1, actions.unsqueeze(1)).squeeze(1)
            loss = functional.smooth_l1_loss(q, goal)
            optimizer.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(parameters, settings.grad_clip, foreach=True)
            optimizer.step()
            with torch.no_grad():
                torch._foreach_lerp_(tracked, parameters, settings.target_polyak)

    return steps


if __name__ == "__main__":
    main()
