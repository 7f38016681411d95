"""One task in one meta-update, as a meta method is given it, and what it answers to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from jouleswarm.common.scenario.scenario import Scenario

if TYPE_CHECKING:
    from torch import Tensor, nn

    from jouleswarm.learning.meta import Rate
    from jouleswarm.learning.task_loss import TensorBatch

    Params = dict[str, Tensor]
    Sample = tuple[TensorBatch, ...]
    Loss = Callable[[Params, Sample], Tensor]


@dataclass(frozen=True)
class Samples:
    """What one meta-update uses of a task's round; a sample is a batch of each of its robots."""

    support: Sequence[Sample]
    query: Sequence[Sample]


@dataclass(frozen=True)
class Rehearsal:
    """One task in one meta-update."""

    params: Params
    """The meta-model's for this task, detached."""
    samples: Samples
    loss: Loss
    """Of a sample: sum over the task's robots k of L_k, eq. (1)."""
    inner_lr: Rate
    """mu; log mu of each layer where the method learns it and the scenario has it so."""
    clip: float
    """Gradients longer than this are shortened to it, the sum over robots as one."""
    inner: tuple[str, ...] | None = None
    """Parameters that adapt; None: all."""


class MetaRule(Protocol):
    """What the stage asks of a meta method (see `methods.meta.MetaMethod`)."""

    plain: bool
    exact: bool
    learns_rates: bool

    def heads(self, scenario: Scenario) -> tuple[int, ...]:
        """Tasks with a last layer of their own."""

    def gradient(self, task: Rehearsal) -> tuple[Params, Params]:
        """A task's direction for the meta-model, and the model that its target network follows."""

    def inner(self, model: nn.Sequential) -> tuple[str, ...] | None:
        """Names of the parameters that adapt; None: all."""

    def updates(self, samples: Samples, inner_steps: int) -> list[Samples]:
        """A round's samples by meta-update."""
