"""Reptile (Nichol et al. 2018) in the data center, then consensus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jouleswarm.methods.meta import MetaMethod
from jouleswarm.methods.rehearsal import Rehearsal

if TYPE_CHECKING:
    from torch import Tensor

    Params = dict[str, Tensor]


class Reptile(MetaMethod):
    """One SGD step a batch; the meta-model goes the way to where they lead."""

    name, label, colour = "reptile", "Reptile", "#CC79A7"
    plain = True

    def gradient(self, task: Rehearsal) -> tuple[Params, Params]:
        """W - phi, and phi after all of the update's batches."""
        from jouleswarm.learning.meta import reptile_gradient

        every = [*task.samples.support, *task.samples.query]
        return reptile_gradient(task.params, every, task.loss, task.inner_lr, task.clip)
