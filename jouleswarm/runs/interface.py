"""What a scenario's robots, environment and network have between them, from where it is cheapest to know."""

from __future__ import annotations

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import Interface, shipped_tensors


def interface_of(scenario: Scenario) -> Interface:
    """All sizes of a scenario: as its run's manifest has them, as the networks that ship here are counted, or, of a
    network of the user's own that nobody has built yet, from the network itself.

    Raises:
        ConfigurationError: environment or network cannot be made.
    """
    if (kept := scenario.interface) is not None:
        return kept
    if (shipped := shipped_tensors(scenario.network, scenario.spaces)) is not None:
        return shipped
    # A late import: nothing else that reads runs needs PyTorch.
    from jouleswarm.learning import networks

    return networks.interface_of(scenario)
