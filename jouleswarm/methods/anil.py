"""ANIL (Raghu et al. 2020): MAML whose inner loop adapts the last layer only."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jouleswarm.methods.meta import MetaMethod
from jouleswarm.methods.rehearsal import Rehearsal

if TYPE_CHECKING:
    from torch import Tensor, nn

    Params = dict[str, Tensor]


class Anil(MetaMethod):
    """Gradient through gradient, of the last layer's adaptation."""

    name, label, colour = "anil", "ANIL", "#F0E442"
    exact, learns_rates = True, True

    def inner(self, model: nn.Sequential) -> tuple[str, ...]:
        """The last layer."""
        from jouleswarm.learning.heads import head_of

        return head_of(model)

    def gradient(self, task: Rehearsal) -> tuple[Params, Params]:
        """Eq. (4), where phi of eq. (3) differs from the meta-model in its last layer."""
        from jouleswarm.learning.meta import meta_gradient

        samples = task.samples
        return meta_gradient(
            task.params, samples.support, samples.query, task.loss, task.inner_lr, exact=True, clip=task.clip,
            inner=task.inner,
        )  # fmt: skip
