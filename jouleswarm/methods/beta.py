"""beta of eq. (9), measured: what gradient through gradient costs over the first-order approximation.

A meta-update adapts on B^(a) batches and takes the gradient on B^(b) batches. In units of one plain batch gradient the
first costs B^(a) and the second B^(b), or beta B^(b) where it goes back through the adaptation. So
beta = (cost of an exact meta-gradient / cost of a plain batch gradient - B^(a)) / B^(b).
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch.utils.flop_counter import FlopCounterMode

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import Observation
from jouleswarm.common.seeding import stream
from jouleswarm.learning.meta import meta_gradient
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.learning.qnetwork import QNetwork
from jouleswarm.learning.replay import Batch
from jouleswarm.learning.task_loss import TensorBatch, make_loss, to_tensors

CPU = torch.device("cpu")
Call = Callable[[], None]


@dataclass(frozen=True)
class Cost:
    """Of one meta-gradient over all of a round's batches of one task; seconds are medians, of the processor."""

    support_batches: int
    query_batches: int
    exact_s: float
    first_order_s: float
    exact_flops: int
    first_order_flops: int

    @property
    def beta_time(self) -> float:
        """beta by time, at least 1."""
        return self._beta(self.exact_s, self.first_order_s)

    @property
    def beta_flops(self) -> float:
        """beta by floating-point operations of matrix products and convolutions, at least 1."""
        return self._beta(self.exact_flops, self.first_order_flops)

    def _beta(self, exact: float, first_order: float) -> float:
        # The first-order meta-gradient is B^(a) + B^(b) plain gradients, measured in the same way as the exact one.
        plain = first_order / (self.support_batches + self.query_batches)
        return max(1.0, (exact / plain - self.support_batches) / self.query_batches)


def measure_beta(
    scenario: Scenario, adapts: Collection[str] | None = None, inner_steps: int | None = None, repeats: int = 3
) -> Cost:
    """Measure on made-up batches of the scenario's network, with `inner_steps` (default the scenario's) a meta-update.

    Both kinds are timed in turn, after one of each that is not counted. `adapts`: parameters that adapt, default all.
    """
    exact, first_order, inner, query = meta_gradients(scenario, adapts, inner_steps)
    kinds = (exact, first_order)
    flops = [_flops(each) for each in kinds]  # also the first run of each, which is not timed
    seconds = [[_seconds(each) for each in kinds] for _ in range(repeats)]
    exact_s, first_order_s = (statistics.median(column) for column in zip(*seconds, strict=True))
    return Cost(inner, query, exact_s, first_order_s, *flops)


def meta_gradients(
    scenario: Scenario,
    adapts: Collection[str] | None = None,
    inner_steps: int | None = None,
    device: torch.device = CPU,
) -> tuple[Call, Call, int, int]:
    """An exact meta-gradient and a first-order one on made-up batches, to be called; and B^(a) and B^(b) of them."""
    inner = scenario.meta.inner_steps if inner_steps is None else inner_steps
    model = build_qnetwork(scenario, 1).to(device)
    params = {name: value.detach() for name, value in model.named_parameters()}
    loss = make_loss(model, params, scenario.learning.discount, double=scenario.learning.double)
    share = scenario.meta.query_batches / scenario.meta.support_batches
    size = scenario.meta.batch_size
    support, query = (
        made_up_batches(scenario, model, size, count, device) for count in (inner, max(1, round(inner * share)))
    )

    def run(*, exact: bool) -> None:
        clip, lr = scenario.learning.grad_clip, scenario.meta.inner_lr
        meta_gradient(params, support, query, loss, lr, exact=exact, clip=clip, inner=adapts)

    return (lambda: run(exact=True)), (lambda: run(exact=False)), inner, len(query)


def made_up_batches(
    scenario: Scenario, model: QNetwork, size: int, count: int, device: torch.device
) -> list[TensorBatch]:
    """`count` batches of `size` transitions as the network takes them, of random observations."""
    actions = len(scenario.spaces.actions)
    rng = stream(scenario.seed, "beta", count)

    def batch() -> TensorBatch:
        made_up = Batch(
            _observations(rng, size, model.takes),
            rng.integers(0, actions, size),
            rng.normal(size=size).astype(np.float32),
            _observations(rng, size, model.takes),
            np.zeros(size, np.float32),
        )
        return to_tensors(made_up, model, device)

    return [batch() for _ in range(count)]


def _observations(rng: np.random.Generator, size: int, takes: Observation) -> npt.NDArray[Any]:
    dtype, shape = np.dtype(takes.dtype), (size, *takes.shape)
    if dtype.kind == "f":
        return rng.normal(size=shape).astype(dtype)
    return rng.integers(0, takes.values or (256 if dtype == np.uint8 else 2), shape).astype(dtype)


def _seconds(call: Callable[[], object]) -> float:
    # Of the processor: by the clock whoever else is at work is in it, and exact gradients, the longer ones, have more.
    begun = time.process_time()
    call()
    return time.process_time() - begun


def _flops(call: Callable[[], object]) -> int:
    with FlopCounterMode(display=False) as counter:
        call()
    return int(counter.get_total_flops())
