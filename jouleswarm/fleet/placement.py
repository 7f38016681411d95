"""Which process of a deployment runs on which worker of a cluster."""

from __future__ import annotations

from collections.abc import Mapping, Sequence


def placed(names: Sequence[str], threads: Mapping[str, int]) -> dict[str, list[str]]:
    """Worker -> processes, as even as it can be by threads; a worker that gets none is left out.

    Each process in turn goes to the worker that has the fewest a thread then, of equals to the first by its address:
    the same workers give the same placement.

    Args:
        names: of processes.
        threads: worker -> how many threads it has, 1 or more; at least one worker.
    """
    held: dict[str, list[str]] = {worker: [] for worker in sorted(threads)}
    for name in names:
        held[min(held, key=lambda worker: (len(held[worker]) + 1) / threads[worker])].append(name)
    return {worker: theirs for worker, theirs in held.items() if theirs}
