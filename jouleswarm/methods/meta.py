"""What all meta-learning methods share: a stage in the data center, eqs. (2)-(5), then consensus as without one.

Each says in its own file how a meta-update's direction is found. PyTorch is loaded when that is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.closed_form import RoundSizes
from jouleswarm.energy.facts import StageCounts
from jouleswarm.methods.consensus import Consensus
from jouleswarm.methods.method import Stage
from jouleswarm.methods.rehearsal import Rehearsal, Samples

if TYPE_CHECKING:
    from torch import nn

    from jouleswarm.methods.rehearsal import Params


class MetaMethod(Consensus):
    """A method with a stage; what it computes before is `gradient`."""

    plain: bool = False
    """Whether all of its gradients are plain ones, B^(b) as B^(a)."""
    learns_rates: bool = False
    """Whether it can learn mu of each layer: `gradient` is given log mu then and returns its gradient too."""

    def stage(self, scenario: Scenario) -> Stage:
        """The meta-learner; loads PyTorch."""
        from jouleswarm.methods.meta_stage import MetaStage

        return MetaStage(scenario, self)

    def gradient(self, task: Rehearsal) -> tuple[Params, Params]:
        """A task's direction for the meta-model, and the model that its target network follows."""
        raise NotImplementedError

    def inner(self, model: nn.Sequential) -> tuple[str, ...] | None:
        """Names of the parameters that adapt; None: all."""
        return None

    def updates(self, samples: Samples, inner_steps: int) -> list[Samples]:
        """A round's samples by meta-update: `inner_steps` support samples each."""
        updates = len(samples.support) // inner_steps
        outer = len(samples.query) // updates
        return [
            Samples(
                samples.support[i * inner_steps : (i + 1) * inner_steps], samples.query[i * outer : (i + 1) * outer]
            )
            for i in range(updates)
        ]

    def closed_form(self, scenario: Scenario, t0: float, rounds: Mapping[int, float], sizes: RoundSizes) -> StageCounts:
        """As of consensus; without query batches all of a round's gradients are plain ones."""
        counts = super().closed_form(scenario, t0, rounds, sizes)
        if not self.plain:
            return counts
        every = counts.ml.gradients_support + counts.ml.gradients_query
        return StageCounts(replace(counts.ml, gradients_support=every, gradients_query=0), counts.fl)
