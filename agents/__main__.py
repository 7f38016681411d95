"""`python -m agents`: one robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jouleswarm.common.options import (
    DEFAULT_BROKER,
    BrokerOption,
    DurableOption,
    KeepEndsOption,
    KeepStateOption,
    KeysOption,
    OtherProcessorOption,
    RunOption,
    ScenarioOption,
    SetOption,
    VerboseOption,
)
from jouleswarm.common.process import process

app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.command()
def main(
    id: Annotated[int, typer.Option(envvar="JOULESWARM_ID", help="Which robot of the scenario this is, from 1.")],
    scenario: ScenarioOption,
    broker: BrokerOption = DEFAULT_BROKER,
    keys: KeysOption = None,
    task: Annotated[
        int | None, typer.Option(envvar="JOULESWARM_TASK", help="Its task; checked against the scenario.")
    ] = None,
    run: RunOption = None,
    state: Annotated[
        Path | None,
        typer.Option(
            envvar="JOULESWARM_STATE", help="Folder to remember each round in: a robot that was killed goes on from it."
        ),
    ] = None,
    durable: DurableOption = False,
    keep_state: KeepStateOption = False,
    keep_ends: KeepEndsOption = False,
    other_processor: OtherProcessorOption = False,
    set_: SetOption = None,
    verbose: VerboseOption = True,
) -> None:
    """Start one robot: it joins its cluster over the broker, learns its task with its neighbours, and ends.

    Every process of a run takes the same scenario file and the same --set options; one that has others is refused.
    Robots may come in any order; each waits for its neighbours and, if the scenario has the arm, for the data center.

    Example: python -m jouleswarm.agents --broker mqtt://localhost:1883 --id 3 --task 2 --scenario quick
    """
    with process(f"robot {id}", verbose=verbose):
        # Late imports: --help and a wrong option answer at once, without PyTorch.
        from jouleswarm.common.bus.joining import Begun, join
        from jouleswarm.common.disk.state import Keep
        from jouleswarm.common.errors import ConfigurationError, RunError, usable
        from jouleswarm.common.host import arithmetic
        from jouleswarm.common.scenario.reading import load_scenario

        settings = load_scenario(scenario, set_ or ())
        assigned = settings.task_of(id)
        if task is not None and task != assigned:
            raise ConfigurationError(
                f"--task {task}: the scenario gives robot {id} task {assigned}; robots of task {task}: "
                f"{list(settings.clusters.get(task, ()))}"
            )
        from jouleswarm.agents.robot import run_agent

        keep = Keep(state, durable, keep_state or keep_ends, keep_ends)
        name, bus = join(settings, id, Begun(broker, keys, run, keep, other_processor), arithmetic)
        with usable("--state", state, RunError):
            run_agent(settings, id, name, bus, keep)


if __name__ == "__main__":
    app()
