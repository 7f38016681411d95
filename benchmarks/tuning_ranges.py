"""What `benchmarks.tuning` tries: methods, the ranges of their settings, and how trials are drawn from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from jouleswarm.common.seeding import stream

SEEDS = (101, 102, 103, 104, 105, 106)
"""For tuning alone; no study has them."""
SCREENED = 2
"""Every trial is run on so many of them, the best quarter on all."""
BASELINE = "fl"
"""Tuned first: the robots' settings that are best without transfer are those of every other method too."""


@dataclass(frozen=True)
class Between:
    """Log-uniform, to two digits."""

    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}, log-uniform"


@dataclass(frozen=True)
class OneOf:
    """Each as often as the others."""

    values: tuple[object, ...]

    def __str__(self) -> str:
        return ", ".join(map(_text, self.values))


Ranges = Mapping[str, Between | OneOf]

ROBOTS: Ranges = {"learning.lr": Between(3e-4, 3e-3), "learning.epsilon": OneOf((0.1, 0.3, 0.6, 1.0))}
OUTER: Ranges = {"meta.meta_lr": Between(3e-4, 3e-3)}
INNER: Ranges = OUTER | {"meta.inner_lr": OneOf((0.001, 0.003, 0.01, 0.03)), "meta.inner_steps": OneOf((1, 2, 5, 10))}
META_SGD: Ranges = {"meta.inner_lr_step": OneOf((0.0, 0.01))}
HEADS: Ranges = {"meta.rehearse_unseen": OneOf((False, True))}


@dataclass(frozen=True)
class Tuned:
    """One row of the outcome: a method, what is fixed for it, and what is tried."""

    name: str
    method: str
    ranges: Ranges
    fixed: tuple[str, ...] = ()


ONE_HEAD = ("meta.heads=shared",)
PAPERS = Tuned("maml-shared", "maml", INNER | META_SGD, ONE_HEAD)
# The order is that of the work: what is worth most comes first.
METHODS = (
    Tuned(BASELINE, "fl", ROBOTS),
    Tuned("multitask", "multitask", OUTER | HEADS),
    PAPERS,
    Tuned("fomaml-shared", "fomaml", INNER | META_SGD, ONE_HEAD),
    Tuned("maml-heads", "maml", INNER | META_SGD | HEADS),
    Tuned("fomaml-heads", "fomaml", INNER | META_SGD | HEADS),
    Tuned("reptile", "reptile", INNER | HEADS),
    Tuned("anil", "anil", INNER | META_SGD | HEADS),
)


def draw(tuned: Tuned, trials: int) -> list[tuple[str, ...]]:
    """Settings of each trial, the same every time: first the scenario's own, then one of each of a range's equal parts,
    parts of different ranges put together by chance (a Latin hypercube)."""
    count = trials - 1
    columns = []
    for name, values in tuned.ranges.items():
        rng = stream(0, "tuning", tuned.name, name)
        if isinstance(values, OneOf):
            every = np.resize(rng.permutation(len(values.values)), count)  # so that what is left over is by chance too
            found = [values.values[index] for index in rng.permutation(every)]
        else:
            places = (rng.permutation(count) + rng.random(count)) / max(count, 1)
            width = math.log(values.high / values.low)
            found = [float(f"{values.low * math.exp(place * width):.2g}") for place in places]
        columns.append([f"{name}={_text(each)}" for each in found])
    return [(), *zip(*columns, strict=True)]


def _text(value: object) -> str:
    """As TOML has it."""
    return f"{value:g}" if isinstance(value, float) else str(value).lower()
