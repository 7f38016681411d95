"""Bad input told before anything starts: environments and networks that do not come with the product are tried."""

from __future__ import annotations

import json
import subprocess

from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import Interface, shipped_tensors
from jouleswarm.energy.prices import price_lists
from jouleswarm.fleet.packages import command_of
from jouleswarm.methods.trial import methods_of, needs_learning

_PREFIX = "trial: "


def try_out(scenario: Scenario) -> None:
    """Make every task's environment and the network in a process of their own; the scenario then knows all its sizes.

    There the model is read that learning begins from, and what methods of the user's do with tensors is tried. Where
    loading the scenario has told all of that already, nothing is made.

    Raises:
        ConfigurationError: one cannot be learned with, or a price list not be priced by: one line that says why.
        RunError: the process died.
    """
    price_lists(scenario)  # here and not where a scenario is read: no robot knows a price
    spaces = scenario.known_spaces
    is_known = spaces is not None and shipped_tensors(scenario.network, spaces) is not None
    if is_known and scenario.learning.init is None and not any(map(needs_learning, methods_of(scenario))):
        return
    given = {"scenario": scenario.model_dump(mode="json"), "folder": scenario.folder and str(scenario.folder)}
    command = command_of("jouleswarm.runs.trial")
    done = subprocess.run(command, input=json.dumps(given), capture_output=True, text=True, check=False)
    if done.returncode:
        said = (done.stderr.strip().splitlines() or [f"the process that tries it ended with {done.returncode}"])[-1]
        error = ConfigurationError if done.returncode == ConfigurationError.exit_code else RunError
        raise error(said.removeprefix(_PREFIX))
    scenario.remember(Interface.model_validate_json(done.stdout.strip().splitlines()[-1]))
