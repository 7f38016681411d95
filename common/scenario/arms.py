"""Learning methods by name, and the arms of a run: which method, from which meta-model."""

from __future__ import annotations

from typing import Literal, NamedTuple

Method = Literal["fl", "isolated", "fedavg", "centralized", "maml", "fomaml", "reptile", "anil", "multitask"]

METHODS: dict[str, str] = {
    "fl": "decentralized federated learning over sidelinks, eq. (6), no transfer",
    "isolated": "each robot by itself, nothing exchanged",
    "fedavg": "federated averaging by a parameter server: weights up, their average down",
    "centralized": "raw observations up, deep Q-learning in the data center, weights down",
    "maml": "MAML in the data center, gradient through gradient (eq. (5)), then fl",
    "fomaml": "MAML with the first-order approximation of eq. (5), then fl",
    "reptile": "Reptile in the data center (Nichol et al. 2018), then fl",
    "anil": "MAML whose inner loop adapts the last layer only (Raghu et al. 2020), then fl",
    "multitask": "joint training on the Q training tasks in the data center, then fl",
}

META_METHODS = ("maml", "fomaml", "reptile", "anil", "multitask")
"""Methods that train a model in the data center first, for robots to start from."""

EXACT_METHODS = ("maml", "anil")
"""Meta methods that differentiate through the adaptation, eq. (5)."""

SERVED_METHODS = ("fedavg", "centralized")
"""Methods in which the data center takes part in every round."""


class Arm(NamedTuple):
    """One column of a run: its name is a level of every topic."""

    name: str
    method: Method
    t0: int
    """Rounds of meta-training behind the model that robots start from; 0 without."""


def arm_name(method: str, t0: int | None = None) -> str:
    """`maml`, or `maml-t42` for an arm that starts from the meta-model of round 42 on the way."""
    return method if t0 is None else f"{method}-t{t0}"


def method_of(arm: str) -> str:
    """The method of an arm, from its name."""
    return arm.partition("-t")[0]


def snapshot_of(arm: str) -> int | None:
    """The round on the way whose meta-model an arm starts from; None for the last one (or for none at all)."""
    _, marked, round_ = arm.partition("-t")
    return int(round_) if marked else None
