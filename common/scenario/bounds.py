"""Bounds of a scenario's numbers."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

# Every number has both bounds: far beyond what anybody runs, and within what arithmetic, memory and messages can hold.
Id = Annotated[int, Field(ge=1, le=1_000_000)]
Robots = Annotated[int, Field(ge=1, le=1000)]
Rounds = Annotated[int, Field(ge=1, le=1_000_000)]
Batches = Annotated[int, Field(ge=1, le=100_000)]  # gradient steps of a round
BatchSize = Annotated[int, Field(ge=1, le=100_000)]
Motions = Annotated[int, Field(ge=1, le=100_000)]
Frames = Annotated[int, Field(ge=3, le=100_000_000)]  # fewer can all be without a successor: nothing to learn from
NetworkPixels = Annotated[int, Field(ge=1, le=1024)]
Channels = Annotated[int, Field(ge=1, le=4096)]
Kernel = Annotated[int, Field(ge=1, le=1024)]
Units = Annotated[int, Field(ge=1, le=1_000_000)]

Fraction = Annotated[float, Field(ge=0, le=1)]
Share = Annotated[float, Field(ge=1e-9, le=1)]
Seconds = Annotated[float, Field(ge=1e-3, le=1e6)]
LearningRate = Annotated[float, Field(ge=1e-37, le=1e3)]  # float32 holds it
Watts = Annotated[float, Field(ge=1e-6, le=1e9)]
BatchSeconds = Annotated[float, Field(ge=1e-9, le=1e6)]
Efficiency = Annotated[float, Field(ge=1e-6, le=1e15)]  # bit/J
Pue = Annotated[float, Field(ge=1, le=1e3)]
BetaFactor = Annotated[float, Field(ge=1, le=1e6)]
BitRate = Annotated[float, Field(ge=1e-3, le=1e15)]  # bit/s
Joules = Annotated[float, Field(ge=0, le=1e12)]
Duration = Annotated[float, Field(ge=0, le=1e6)]  # seconds that may be none
IdleWatts = Annotated[float, Field(ge=0, le=1e9)]
Loss = Annotated[float, Field(ge=0, le=0.999)]  # share of what is sent that does not arrive
Metres = Annotated[float, Field(ge=-1e7, le=1e7)]
CarbonIntensity = Annotated[float, Field(ge=0, le=1e6)]  # gCO2e a kWh

TOPOLOGIES = ("full", "ring", "random")
