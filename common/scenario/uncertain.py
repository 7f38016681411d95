"""A constant that is not known exactly: a range, and what lies in it."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from jouleswarm.common.scenario.sections import Section


class Uncertain(Section):
    """`{low = 100e3, high = 400e3}`: any value between them; with `likely` that one more than others (triangular)."""

    low: float = Field(description="nothing is below")
    high: float = Field(description="nothing is above")
    likely: float | None = Field(None, description="what is likelier than all else (triangular), and the nominal value")
    shape: Literal["uniform", "loguniform"] = Field("uniform", description="loguniform: uniform in the logarithm")

    @property
    def nominal(self) -> float:
        """What the bill without draws has: `likely`, else the middle."""
        if self.likely is not None:
            return self.likely
        return (self.low * self.high) ** 0.5 if self.shape == "loguniform" else (self.low + self.high) / 2

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        likely = self.low if self.likely is None else self.likely
        if not self.low <= likely <= self.high:
            raise ValueError(f"got low {self.low:g}, likely {self.likely}, high {self.high:g}; expected that order")
        if self.shape == "loguniform" and (self.likely is not None or self.low <= 0):
            raise ValueError("a loguniform range has a low above 0 and no likely value")
        return self
