"""Whether anything was learned at all: a run in which nobody computed a gradient is none."""

from __future__ import annotations

from collections.abc import Iterable

from jouleswarm.common.errors import RunError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import RowPhase


def check_learning(scenario: Scenario, rows: Iterable[RoundRow]) -> None:
    """Look for gradients in every stage of a run that has come to its end.

    Raises:
        RunError: a stage of an arm has none; the message names them.
    """
    computed = {(row.phase, row.arm) for row in rows if row.gradients > 0 or (row.learned and not row.round)}
    meta = [((RowPhase.ML, method), f"the meta-learning of {method}") for method in scenario.meta_methods]
    arms = [(("fl", arm), f"arm {arm}") for arm in scenario.arm_names]
    if idle := [told for stage, told in (*meta, *arms) if stage not in computed]:
        raise RunError(
            f"nobody computed a gradient in {', '.join(idle)}; expected some in each: the run is not complete, see "
            "what its processes printed"
        )
