"""A round in one line, for who started a process by hand and looks at its shell. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.topics import Link
from jouleswarm.common.wire.types import RowPhase


def round_line(row: RoundRow, received: Mapping[Link, int]) -> str:
    """`fl, task 2, round 12: own reward 23.1, R of the cluster 20.4, 20 gradients, 1.2 MB received so far`.

    `received`: payload bytes by link class, since the process began.
    """
    where = f"{row.arm}, task {row.task}, "
    stage = "meta-learning " if row.phase == RowPhase.ML else ""
    told = []
    if row.reward is not None:
        told.append(f"own reward {row.reward:.1f}")
    if row.cluster_reward is not None:
        told.append(f"R of the cluster {row.cluster_reward:.1f}")
    if row.phase == RowPhase.ML and row.agent:
        told.append("experience sent up")
    if row.gradients:
        told.append(f"{row.gradients} gradients")
    moved = sum(count for link, count in received.items() if link != Link.CONTROL)
    told.append(f"{moved / 1e6:.1f} MB received so far")
    end = {None: "", True: "; learned", False: "; not learned"}[row.learned]
    return f"{where}{stage}round {row.round}: {', '.join(told)}{end}"
