"""`python -m jouleswarm.runs.trial`: make every task's environment and the network once, before a run starts.

Reads {"scenario": ..., "folder": ...} from standard input; its last line is the scenario's `Interface` as JSON. A
process of its own: whatever a user's code does, the launcher stays as it is, and loads no PyTorch.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from jouleswarm.codecs.trial import try_experience
from jouleswarm.common.errors import ConfigurationError, RunError
from jouleswarm.common.process import one_line_errors
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import Interface
from jouleswarm.environments.environment import TaskEnvironment


def tried(scenario: Scenario) -> Interface:
    """Begin an episode of every task, send an observation up, feed the network, read the model to begin from, and try
    what methods add.

    Raises:
        ConfigurationError: something is not what can be learned with; one line that says why.
    """
    for task in scenario.tasks:
        _begun(scenario, task.id)
    try_experience(scenario)
    from jouleswarm.learning.networks import build_qnetwork, interface_of
    from jouleswarm.learning.start import saved_start
    from jouleswarm.methods.trial import try_learning

    build_qnetwork(scenario, 1)
    saved_start(scenario)
    try_learning(scenario)
    return interface_of(scenario)


def _begun(scenario: Scenario, task: int) -> None:
    try:
        environment = TaskEnvironment(scenario, task)
        environment.show(scenario.spaces.observation.kept(scenario.network))
        environment.reset(seed=1)
        environment.show(None)
        for where in {scenario.learning.starts, scenario.meta_starts}:
            for options in environment.starts(where, 0, len(scenario.cluster(task)))[:1]:
                environment.reset(seed=1, options=options)
        action = environment.guide() if environment.has_guide else 0
        environment.step(action)
        environment.judge(0.0)
        if environment.can_look:
            environment.look()
        if environment.can_go_on:
            place = environment.place()
            environment.reset()
            environment.load_place(place)
    except RunError as error:  # nothing runs yet
        raise ConfigurationError(str(error)) from error


def main() -> None:
    given = json.load(sys.stdin)
    folder = None if given["folder"] is None else Path(given["folder"])
    with one_line_errors("trial"):
        interface = tried(scenario_from(given["scenario"], given["scenario"]["name"], folder))
    print()  # whatever the user's code printed
    print(interface.model_dump_json())


if __name__ == "__main__":
    main()
