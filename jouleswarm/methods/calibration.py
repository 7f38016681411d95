"""The user's own Table I: what a batch gradient of a scenario's network takes on this machine, in seconds and joules.

T_k and T_0 of eqs. (8) and (9) are the median of a batch gradient's seconds, P_k and P_0 its mean joules over that,
beta as in `methods.beta`. Joules are had as those of `--measure` are (see `common.meter.power`).
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.power import gpu, processor
from jouleswarm.common.scenario.measure import Measure
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.learning.device import accelerator_uuid
from jouleswarm.learning.meta import clipped, plain_gradient
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.learning.task_loss import make_loss
from jouleswarm.methods.beta import Call, Cost, made_up_batches, meta_gradients

ROBOT, DATACENTER = ROLES = ("robot", "datacenter")
DEVICES = ("cpu", "cuda")
_WARM_UP = 3
_WINDOW_S = 2.0  # joules are read before and after: counters are not finer than some 10 ms

Told = Callable[[float], None]
"""Hears which part of the work is done, 0 to 1."""


@dataclass(frozen=True)
class Calibration:
    """Of one role on one device."""

    role: str
    parameters: int
    seconds: tuple[float, ...]
    """Of each batch gradient."""
    joules: float | None
    """Of a batch gradient, the mean; None where the device has no counter."""
    how: str
    """It was had."""
    beta: float | None
    """Of the data center."""

    @property
    def batch_s(self) -> float:
        """T_k or T_0."""
        return statistics.median(self.seconds)

    @property
    def quartiles_s(self) -> tuple[float, float]:
        """Half of all gradients took between these."""
        first, _, third = statistics.quantiles(self.seconds, n=4, method="inclusive")
        return first, third

    @property
    def watts(self) -> float | None:
        """P_k or P_0: so that times `batch_s` it is the joules of a batch."""
        return None if self.joules is None else self.joules / self.batch_s

    @property
    def constants(self) -> dict[str, float]:
        """Fields of the scenario's section energy -> what was measured."""
        names = ("tk_batch_s", "pk_w") if self.role == ROBOT else ("t0_batch_s", "p0_w", "beta")
        held = zip(names, (self.batch_s, self.watts, self.beta), strict=False)
        return {name: float(f"{value:.4g}") for name, value in held if value is not None}


def calibrate(scenario: Scenario, role: str, device: str, repeats: int, told: Told) -> Calibration:
    """Measure on made-up batches of the scenario's network, in one thread of the processor, as robots compute.

    Raises:
        ConfigurationError: no such role, or no such device here.
    """
    if role not in ROLES:
        raise ConfigurationError(f"--role {role}: expected {' or '.join(ROLES)}")
    if device not in DEVICES:
        raise ConfigurationError(f"--device {device}: expected {' or '.join(DEVICES)}")
    if device == "cuda" and not torch.cuda.is_available():
        raise ConfigurationError("--device cuda: PyTorch finds no such device here; expected cpu")
    place = torch.device(device)
    wait: Call | None = torch.cuda.synchronize if device == "cuda" else None
    gradient, parameters = _gradient(scenario, role, place)
    share = 0.5 if role == DATACENTER else 1.0
    for _ in range(_WARM_UP):
        _seconds(gradient, wait)
    seconds, joules, how = _drawn(
        scenario.measure, lambda: _seconds(gradient, wait), repeats, device, lambda part: told(share * part)
    )
    beta = None
    if role == DATACENTER:
        beta = _beta(scenario, place, wait, max(3, repeats // 3), lambda part: told(share + share * part))
    return Calibration(role, parameters, tuple(seconds), joules, how, beta)


def _gradient(scenario: Scenario, role: str, device: torch.device) -> tuple[Call, int]:
    """A batch gradient of eq. (7), to be called, and the number of parameters."""
    model = build_qnetwork(scenario, 1).to(device)
    params = {name: value.detach() for name, value in model.named_parameters()}
    size = (scenario.learning if role == ROBOT else scenario.meta).batch_size
    (batch,) = made_up_batches(scenario, model, size, 1, device)
    loss = make_loss(model, params, scenario.learning.discount, double=scenario.learning.double)

    def gradient() -> None:
        clipped(plain_gradient(loss, params, [batch]), scenario.learning.grad_clip)

    return gradient, sum(value.numel() for value in params.values())


def _drawn(
    settings: Measure, sample: Callable[[], float], repeats: int, device: str, told: Told
) -> tuple[list[float], float | None, str]:
    """Seconds of each of `repeats` gradients or more, mean joules of one, and how these were had."""
    counter, card = processor(settings), gpu(accelerator_uuid()) if device == "cuda" else None
    counter.joules(0.0)
    begun, cpu, seconds = time.perf_counter(), time.process_time(), list[float]()
    while len(seconds) < repeats or time.perf_counter() - begun < _WINDOW_S:
        seconds.append(sample())
        told(min(1.0, len(seconds) / repeats, (time.perf_counter() - begun) / _WINDOW_S))
    joules = counter.joules(time.process_time() - cpu)
    if device == "cpu":
        return seconds, joules / len(seconds), counter.how
    if card is None:
        return seconds, None, "the GPU's counter cannot be read"
    return seconds, (joules + card.joules()) / len(seconds), f"{card.how} + {counter.how}"


def _beta(scenario: Scenario, device: torch.device, wait: Call | None, repeats: int, told: Told) -> float:
    exact, first_order, inner, query = meta_gradients(scenario, device=device)
    pairs = []
    for done in range(repeats + 1):
        pairs.append([_seconds(each, wait) for each in (exact, first_order)])
        told(done / repeats)
    timed = pairs[1:]  # the first is a warm-up
    exact_s, first_order_s = (statistics.median(column) for column in zip(*timed, strict=True))
    return Cost(inner, query, exact_s, first_order_s, 0, 0).beta_time


def _seconds(call: Call, wait: Call | None) -> float:
    """`wait`: for the GPU to be done. Without one by CPU time: what one thread takes where nobody else computes."""
    clock = time.process_time if wait is None else time.perf_counter
    ready = wait or (lambda: None)
    ready()
    begun = clock()
    call()
    ready()
    return clock() - begun
