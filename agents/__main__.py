"""`python -m agents`: one robot."""

from __future__ import annotations

from typing import Annotated

import typer

from jouleswarm.common.options import Started, with_started
from jouleswarm.common.process import process

app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.command()
@with_started
def main(
    started: Started,
    id: Annotated[int, typer.Option(envvar="JOULESWARM_ID", help="Which robot of the scenario this is, from 1.")],
    task: Annotated[
        int | None, typer.Option(envvar="JOULESWARM_TASK", help="Its task; checked against the scenario.")
    ] = None,
) -> None:
    """Start one robot: it joins its cluster over the broker, learns its task with its neighbours, and ends.

    Every process of a run takes the same scenario file and the same --set options; one that has others is refused.
    Robots may come in any order; each waits for its neighbours and, if the scenario has the arm, for the data center.

    Example: python -m jouleswarm.agents --broker mqtt://localhost:1883 --id 3 --task 2 --scenario quick
    """
    with process(f"robot {id}", verbose=started.verbose, quiet=started.quiet):
        # Late imports: --help and a wrong option answer at once, without PyTorch.
        from jouleswarm.common.bus.joining import join
        from jouleswarm.common.errors import ConfigurationError, RunError, usable
        from jouleswarm.common.host import arithmetic
        from jouleswarm.common.scenario.reading import load_scenario

        settings = load_scenario(started.scenario, started.set_ or ())
        assigned = settings.task_of(id)
        if task is not None and task != assigned:
            raise ConfigurationError(
                f"--task {task}: the scenario gives robot {id} task {assigned}; robots of task {task}: "
                f"{list(settings.clusters.get(task, ()))}"
            )
        from jouleswarm.agents.robot import run_agent

        name, bus = join(settings, id, started, arithmetic)
        with usable("--state", started.state, RunError):
            run_agent(settings, id, name, bus, started.keep)


if __name__ == "__main__":
    app()
