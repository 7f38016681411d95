"""Which faults are to be done, and when: every kind in every phase of a run in which it makes sense."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jouleswarm.chaos.faults import TWINS, FaultKind

PHASES = ("starting", "meta-learning", "federated", "leaving")
"""`starting` lasts to the first row, `federated` from the first robot's row of an arm to the next stage; `leaving` is
from where all robots are done with their last arm, or the last rows are coming, to the end of the run."""

_ONLY: dict[FaultKind, tuple[str, ...]] = {
    "weights cut": ("federated",),
    "frame cut": ("meta-learning",),
    "duplicates": PHASES[1:],
    "same robot twice": PHASES[:3],  # who has left can no more be done twice
    "same state twice": PHASES[:3],
    "state lost": PHASES[1:],  # nobody has told a round before
    "disk full": PHASES[1:3],  # who leaves may have nothing more to write
}
FAILED = "NOT "
"""How a note begins of what should have been noticed, and was not."""


@dataclass
class Fault:
    """One fault that was injected."""

    kind: FaultKind
    phase: str
    target: str = ""
    run: str = ""
    at_s: float = 0.0
    recovery_s: float | None = None
    """From the fault to the next row of whom it was done to (of anybody, where that is no process); to the end of the
    run, where it was leaving and there is no more row."""
    identical: bool | None = None
    conserved: bool | None = None
    """Whether what broker and clients have counted fits together."""
    note: str = ""

    @property
    def is_survived(self) -> bool:
        """Whether it has changed nothing but the clock, and was noticed where it must be."""
        is_noticed = bool(self.note) if self.kind in (*TWINS, "state lost", "disk full") else True
        return bool(self.identical and self.conserved) and is_noticed and not self.note.startswith(FAILED)


def plan_faults(count: int, kinds: Sequence[FaultKind], has_meta: bool) -> list[Fault]:
    """`count` faults: all kinds in turn, each time in another phase, until every kind was in every phase; then anew."""
    phases = PHASES if has_meta else (PHASES[0], *PHASES[2:])
    pairs = [
        (kind, phases[(start + turn) % len(phases)])
        for turn in range(len(phases))
        for start, kind in enumerate(kinds)
        if _makes_sense(kind, phases[(start + turn) % len(phases)], has_meta)
    ]
    return [Fault(*pairs[index % len(pairs)]) for index in range(count)]


def _makes_sense(kind: FaultKind, phase: str, has_meta: bool) -> bool:
    return phase in _ONLY.get(kind, PHASES) and (kind != "data center killed" or has_meta)
