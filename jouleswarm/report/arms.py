"""What arms are called and how they are coloured, in reports, figures and the live view.

Colours are Okabe and Ito's, told apart by colour-blind readers, with a brown as the ninth. As in the paper, MAML is
orange and learning without transfer is blue. Arms that start from an earlier meta-model of a method have its colour,
paler the earlier the model.
"""

from __future__ import annotations

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.report.look import Look, looks_of, tint

INK = "#1d1d24"

_PALEST = 0.4  # of a method's colour, the rest is white


def method_label(scenario: Scenario, method: str) -> str:
    """`MAML`, `FL, no transfer`: what a method calls itself, by its name."""
    found = scenario.method(method)
    return str(found.label or found.name)


def method_colour(scenario: Scenario, method: str) -> str:
    """`#E69F00`: a method's own, by its name."""
    return str(scenario.method(method).colour)


def label(scenario: Scenario, arm: Arm) -> str:
    """`MAML, t0 = 42`, `FL, no transfer`."""
    name = method_label(scenario, arm.method)
    return f"{name}, t0 = {arm.t0}" if arm.t0 else name


def labels(scenario: Scenario) -> dict[str, str]:
    """Labels of a scenario's arms by their names."""
    return {arm.name: label(scenario, arm) for arm in scenario.arms}


def colours(scenario: Scenario) -> dict[str, str]:
    """Colours of a scenario's arms by their names, no two alike."""
    found = {}
    for method in scenario.method_names:
        colour = method_colour(scenario, method)
        own = [arm for arm in scenario.arms if arm.method == method]
        for place, arm in enumerate(own, start=1):
            strength = 1.0 if place == len(own) else _PALEST + (1 - _PALEST) * (place - 1) / (len(own) - 1)
            found[arm.name] = colour if strength == 1 else tint(colour, strength)
    return found


def looks(scenario: Scenario) -> dict[str, Look]:
    """Looks of a scenario's arms by their names."""
    held = colours(scenario)
    return dict(zip(held, looks_of(list(held.values())), strict=True))
