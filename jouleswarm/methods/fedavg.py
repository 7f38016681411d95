"""Federated averaging by a parameter server (McMahan et al. 2017): weights up, the cluster's average down."""

from __future__ import annotations

from jouleswarm.methods.method import Method


class FedAvg(Method):
    """The data center answers a cluster's round with its models' average, weighed by |E_k|; robots go on from that.

    With a lossy codec both sides keep what a message could not tell and add it to the next one (error feedback, as in
    Sattler et al. 2019); messages build on the average, which everybody has.
    """

    name, label, colour = "fedavg", "FedAvg by server", "#56B4E9"
    partners = "datacenter"
