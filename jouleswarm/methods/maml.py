"""MAML (Finn et al. 2017), as the paper has it: eqs. (3)-(5) in the data center, then consensus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jouleswarm.methods.meta import MetaMethod
from jouleswarm.methods.rehearsal import Rehearsal

if TYPE_CHECKING:
    from torch import Tensor

    Params = dict[str, Tensor]


class Maml(MetaMethod):
    """Gradient through gradient, eq. (5)."""

    name, label, colour = "maml", "MAML", "#E69F00"
    exact, in_paper, learns_rates = True, True, True

    def gradient(self, task: Rehearsal) -> tuple[Params, Params]:
        """The query loss's gradient of eq. (4), and phi of eq. (3)."""
        from jouleswarm.learning.meta import meta_gradient

        samples = task.samples
        return meta_gradient(
            task.params, samples.support, samples.query, task.loss, task.inner_lr, exact=self.exact, clip=task.clip
        )


class FirstOrderMaml(Maml):
    """With the first-order approximation of eq. (5): the Jacobian is taken as the identity."""

    name, label, colour = "fomaml", "FOMAML", "#D55E00"
    exact = False
