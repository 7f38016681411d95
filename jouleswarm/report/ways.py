"""How an arm learns, and what it spends joules on, in plain words. Pure."""

from __future__ import annotations

from jouleswarm.common.scenario.environments import LANDMARKS
from jouleswarm.common.scenario.scenario import Scenario

_CAUSES = {
    "computing_datacenter": "computing in the data center",
    "computing_robots": "computing on the robots",
    "downlink": "models on the downlink",
    "sidelink": "weights on the sidelinks",
    "acting": "the robots' motions",
    "evaluating": "greedy episodes",
    "waiting": "waiting",
    "other": "what no cause has a name for",
}
"""What joules were spent on; of the uplink it depends on what went up."""


def way_words(scenario: Scenario, name: str) -> str:
    """How a method learns, in plain words, by what the core knows of it."""
    method = scenario.method(name)
    who, how = {
        "neighbours": ("each cluster", ", its robots sharing weights"),
        "datacenter": ("each cluster", " through a server"),
        "nobody": ("each robot", " alone"),
    }[method.partners]
    if method.stage is not None:
        return f"a data center trains a model on the robots' {_seen(scenario)}; {who} adapts it{how}"
    if method.sends == "experience":
        return "the data center learns each task from what its robots send up"
    return f"{who} learns from scratch{how}"


def cause_words(scenario: Scenario, name: str, cause: str) -> str:
    """What a part of an arm's joules was spent on, by a key of `energy.bill.CAUSES`."""
    if cause != "uplink":
        return _CAUSES[cause]
    arm = next(arm for arm in scenario.arms if arm.name == name)
    if not arm.t0 and scenario.method(arm.method).sends == "weights":
        return "weights on the uplink"
    raw = "raw " if scenario.meta.experience_codec == "raw" else ""
    return f"{raw}{_seen(scenario)} on the uplink"


def _seen(scenario: Scenario) -> str:
    return "frames" if scenario.environment == LANDMARKS else "observations"
