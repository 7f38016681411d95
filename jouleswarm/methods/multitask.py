"""Joint training on the Q training tasks in the data center, eq. (2) without adaptation, then consensus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jouleswarm.methods.meta import MetaMethod
from jouleswarm.methods.rehearsal import Rehearsal, Samples

if TYPE_CHECKING:
    from torch import Tensor

    Params = dict[str, Tensor]


class Multitask(MetaMethod):
    """An update for each batch, by the tasks' own gradients."""

    name, label, colour = "multitask", "multitask", "#009E73"
    plain = True

    def gradient(self, task: Rehearsal) -> tuple[Params, Params]:
        """The loss's gradient at the model itself, which its target network follows."""
        from jouleswarm.learning.meta import plain_gradient

        return plain_gradient(task.loss, task.params, task.samples.support), task.params

    def updates(self, samples: Samples, inner_steps: int) -> list[Samples]:
        """One for each sample."""
        return [Samples([each], []) for each in (*samples.support, *samples.query)]
