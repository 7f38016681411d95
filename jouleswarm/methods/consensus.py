"""Learning by robots alone: with their neighbours over the sidelinks, eq. (6), and each by itself."""

from __future__ import annotations

from collections.abc import Mapping

from jouleswarm.common.wire.types import Weights
from jouleswarm.methods.method import Method, Update
from jouleswarm.methods.mixing import mix, mixing_weights


class Consensus(Method):
    """Decentralized federated averaging; with a lossy codec each robot keeps its own precision."""

    def mix_lossy(self, own: Weights, told: Weights, theirs: Mapping[int, Update], step: float) -> Weights:
        """Eq. (6) with what all hold of each other: differences are mixed, so that W_k loses nothing by rounding."""
        others = {agent: update.weights for agent, update in theirs.items()}
        sigma = mixing_weights({agent: update.samples for agent, update in theirs.items()})
        return mix(own, others, sigma, step, told)


class Federated(Consensus):
    """Decentralized federated learning over sidelinks, eq. (6), no transfer."""

    name, label, colour = "fl", "FL, no transfer", "#0072B2"
    in_paper = True


class Isolated(Method):
    """Each robot by itself, nothing exchanged."""

    name, label, colour = "isolated", "isolated robots", "#703010"
    partners = "nobody"


BASELINE = Federated.name
"""The arm that transfer is held against: the same after the stage, and no stage."""
