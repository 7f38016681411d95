"""Random streams: one for each purpose, so that no process's draws depend on another's timing."""

from __future__ import annotations

import zlib

import numpy as np


def stream(seed: int, *names: str | int) -> np.random.Generator:
    """A generator that depends on the scenario's seed and on what it is for, and on nothing else."""
    return np.random.default_rng(np.random.SeedSequence([seed, *map(_number, names)]))


def integer(seed: int, *names: str | int) -> int:
    """A 31-bit seed for libraries that want one number."""
    return int(stream(seed, *names).integers(2**31))


def _number(name: str | int) -> int:
    return name if isinstance(name, int) else zlib.crc32(name.encode())
