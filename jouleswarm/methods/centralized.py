"""Centralized learning: raw observations up, deep Q-learning in the data center, weights down."""

from __future__ import annotations

from jouleswarm.common.wire.types import Weights
from jouleswarm.methods.method import ClusterRound, Method


class Centralized(Method):
    """One learner a task, with all its robots' transitions and as many gradient steps as they would have taken."""

    name, label, colour = "centralized", "centralized", "#1d1d24"
    partners = "datacenter"
    sends = "experience"

    def serve(self, round_: ClusterRound) -> tuple[Weights, int]:
        """The task's model after this round's gradient steps."""
        assert round_.learner is not None
        gradients = round_.learner.learn(round_.batches)
        return round_.learner.weights(), gradients
