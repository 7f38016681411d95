"""What learning begins from where nothing was learned before it: random weights, or a model of an earlier run."""

from __future__ import annotations

import numpy as np

from jouleswarm.common.errors import ConfigurationError, PayloadError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.seeding import integer
from jouleswarm.common.wire.saved_models import read_saved_model
from jouleswarm.common.wire.types import Weights
from jouleswarm.learning.heads import start_of
from jouleswarm.learning.networks import build_qnetwork, shapes_of, to_weights


def start_weights(scenario: Scenario, task: int) -> Weights:
    """The network that robots of `task` begin from without a stage, the same for all, as averaging needs.

    `learning.init`, with the task's own last layer where the model has one; else random weights.

    Raises:
        ConfigurationError: as `saved_start`.
    """
    saved = saved_start(scenario)
    if saved is not None:
        return start_of(saved, task)
    return to_weights(build_qnetwork(scenario, integer(scenario.seed, "initial weights", task)))


def saved_start(scenario: Scenario) -> Weights | None:
    """The model of `learning.init`, with all of its last layers; None where none is named.

    Raises:
        ConfigurationError: it cannot be read, or is not of the scenario's network.
    """
    if scenario.learning.init is None:
        return None
    path = scenario.beside(scenario.learning.init)
    what = f"learning.init {path}"
    try:
        saved = read_saved_model(path.read_bytes())
    except (OSError, PayloadError) as error:
        raise ConfigurationError(f"{what}: cannot be read ({error}); expected a file of a run's weights/") from error
    shapes = shapes_of(build_qnetwork(scenario))
    found = {name: tensor.shape for name, tensor in saved.items()}
    plain = {name: shape for name, shape in found.items() if "/" not in name}
    for name in [*shapes, *plain]:
        if plain.get(name) != shapes.get(name):
            told = [str(list(each)) if each is not None else "nothing" for each in (plain.get(name), shapes.get(name))]
            raise ConfigurationError(
                f"{what}: {name} is {told[0]}, expected {told[1]}: a model of the scenario's network"
            )
    for name, shape in found.items():  # heads, as task1/7.weight
        if "/" in name and shapes.get(name.partition("/")[2]) != shape:
            raise ConfigurationError(f"{what}: {name} is {list(shape)}, expected the shape of the network's last layer")
    return {name: np.array(tensor, np.float32) for name, tensor in saved.items()}
