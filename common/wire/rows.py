"""A row of the run log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, SerializerFunctionWrapHandler, model_serializer


class RoundRow(BaseModel):
    """One robot's round (or, agent 0, one training task of the data center's MAML round)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    phase: Literal["maml", "fl"]
    """maml: the meta-learning stage in the data center, by whatever method. fl: everything else."""
    arm: str
    task: int
    agent: int
    round: int
    """0: before all learning, with the means over as many episodes as R's window has."""
    reward: float | None = None
    """Discounted return of the robot's greedy episode from the entry."""
    cluster_reward: float | None = None
    """R, which decides whether the task is learned: see methods/ledger.py."""
    rmse_m: float | None = None
    measures: dict[str, float] = {}
    """What else the environment tells of that episode (`reached`: 1, or 0 where it missed its end); left out of a row
    where there is nothing."""
    ran_away: float | None = None
    """Mean |Q| of what was done in that episode, where it is far beyond any return of its rewards (see
    `learning.dqn.ran_away`); left out of a row where it is not."""
    gradients: int = 0
    """Batch gradients really computed; of the data center support + query."""
    gradients_support: int | None = None
    gradients_query: int | None = None
    beta: float | None = None
    """Cost of an exact meta-gradient over a first-order one, where the data center measured it."""
    experience_bytes: int | None = None
    """Payload bytes of raw observations that the data center's round was learned from."""
    motions: int | None = None
    """Of a robot: transitions that it made to learn from; None in rows from before they were told."""
    evaluation_motions: int | None = None
    """Of a robot: steps of its greedy episodes, each a forward pass too; None as well."""
    learned: bool | None = None
    """On a robot's last row of an arm: whether R reached the target."""
    missed: tuple[int, ...] = ()
    """Neighbours without whom the robot went on (federation.on_missing = "proceed")."""
    refused: int = 0
    """Payloads refused so far."""
    seconds: float

    @model_serializer(mode="wrap")
    def _without_the_exceptional(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = write(self)
        if not self.measures:
            written.pop("measures", None)
        if self.ran_away is None:
            written.pop("ran_away", None)
        return written

    def is_over(self, max_rounds: int, target_reward: float) -> bool:
        """Whether an arm that ended with this row ends there too with limits that are no lower."""
        reached = self.cluster_reward is not None and self.cluster_reward >= target_reward
        return self.round >= max_rounds or (bool(self.learned) and reached)

    def sort_key(self) -> tuple[str, str, int, int, int]:
        """Order of the finished file, whatever the order of arrival."""
        return self.arm, {"maml": "0"}.get(self.phase, "1"), self.task, self.agent, self.round


def measured(measures: Mapping[str, float]) -> dict[str, Any]:
    """Measures of an episode as fields of a row: one that is a column of its own stands there."""
    rest = {name: value for name, value in measures.items() if name != "rmse_m"}
    return {"rmse_m": measures.get("rmse_m"), "measures": rest}
