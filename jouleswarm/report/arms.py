"""What arms are called and how they are coloured, in reports, figures and the live view.

Colours are Okabe and Ito's, told apart by colour-blind readers, with a brown as the ninth. As in the paper, MAML is
orange and learning without transfer is blue. Arms that start from an earlier meta-model of a method have its colour,
paler the earlier the model.
"""

from __future__ import annotations

from jouleswarm.common.scenario.arms import META_METHODS, Arm
from jouleswarm.common.scenario.scenario import Scenario

INK = "#1d1d24"

METHOD_LABELS = {
    "fl": "FL, no transfer",
    "isolated": "isolated robots",
    "fedavg": "FedAvg by server",
    "centralized": "centralized",
    "maml": "MAML",
    "fomaml": "FOMAML",
    "reptile": "Reptile",
    "anil": "ANIL",
    "multitask": "multitask",
}
METHOD_COLOURS = {
    "fl": "#0072B2",
    "isolated": "#703010",
    "fedavg": "#56B4E9",
    "centralized": INK,
    "maml": "#E69F00",
    "fomaml": "#D55E00",
    "reptile": "#CC79A7",
    "anil": "#F0E442",
    "multitask": "#009E73",
}
_PALEST = 0.4  # of a method's colour, the rest is white


def label(arm: Arm) -> str:
    """`MAML, t0 = 42`, `FL, no transfer`."""
    name = METHOD_LABELS[arm.method]
    return f"{name}, t0 = {arm.t0}" if arm.method in META_METHODS else name


def labels(scenario: Scenario) -> dict[str, str]:
    """Labels of a scenario's arms by their names."""
    return {arm.name: label(arm) for arm in scenario.arms}


def colours(scenario: Scenario) -> dict[str, str]:
    """Colours of a scenario's arms by their names, no two alike."""
    found = {}
    for method in scenario.methods:
        own = [arm for arm in scenario.arms if arm.method == method]
        for place, arm in enumerate(own, start=1):
            strength = 1.0 if place == len(own) else _PALEST + (1 - _PALEST) * (place - 1) / (len(own) - 1)
            found[arm.name] = METHOD_COLOURS[method] if strength == 1 else _tint(METHOD_COLOURS[method], strength)
    return found


def _tint(colour: str, strength: float) -> str:
    parts = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
    return "#" + "".join(f"{round(255 - strength * (255 - part)):02x}" for part in parts)
