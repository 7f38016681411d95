"""beta of eq. (9) where it is to be the measured one: from the data center's rows, arm by arm."""

from __future__ import annotations

from collections.abc import Iterable
from statistics import fmean

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.arms import method_of
from jouleswarm.common.scenario.sections import Energy
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.methods.shipped import shipped


def with_beta(energy: Energy, rows: Iterable[RoundRow], arm: str) -> Energy:
    """`energy` with a number for beta: as given, or where it is "measured" what the data center measured.

    Methods without gradient through gradient have beta = 1 by definition.

    Raises:
        ConfigurationError: the arm's method was not measured in this run.
    """
    if energy.beta != "measured":
        return energy
    method = method_of(arm)
    mine = [row for row in rows if (row.arm, row.phase, row.agent) == (method, "maml", 0)]
    kind = shipped(method)  # of a user's: where it has gradients on B^(b), they may be exact
    if not (any(row.gradients_query for row in mine) if kind is None else kind.exact and mine):
        return energy.model_copy(update={"beta": 1.0})
    found = [row.beta for row in mine if row.beta is not None]
    if not found:
        raise ConfigurationError(
            f"beta of {method} was not measured in this run; run it with --set energy.beta=measured, or give --beta a "
            "number (`python -m benchmarks.meta_gradient` measures one)"
        )
    return energy.model_copy(update={"beta": fmean(found)})
