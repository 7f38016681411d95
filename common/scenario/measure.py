"""The section of what is measured beside what is counted."""

from __future__ import annotations

from pydantic import Field

from jouleswarm.common.scenario.bounds import Robots, Share, Watts
from jouleswarm.common.scenario.sections import Section


class Measure(Section):
    """Joules that each process measures of itself (docs/energy.md). Where no counter of the processor can be read they
    are estimated as CPU time x share x tdp_w / cores."""

    energy: bool = Field(False, description="whether to: `jouleswarm run --measure`")
    tdp_w: Watts = Field(85.0, description="thermal design power of the whole processor, for the estimate")
    cores: Robots | None = Field(None, description="that it has; default as many as this machine sees")
    share: Share = Field(1.0, description="of tdp_w that is drawn when all cores compute")
