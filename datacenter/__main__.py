"""`python -m datacenter`: the data center."""

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
    scenario: ScenarioOption,
    broker: BrokerOption = DEFAULT_BROKER,
    keys: KeysOption = None,
    run: RunOption = None,
    state: Annotated[
        Path | None,
        typer.Option(envvar="JOULESWARM_STATE", help="Folder for a checkpoint each round; resumes from one it holds."),
    ] = None,
    durable: DurableOption = False,
    keep_state: KeepStateOption = False,
    keep_ends: KeepEndsOption = False,
    other_processor: OtherProcessorOption = False,
    set_: SetOption = None,
    verbose: VerboseOption = True,
) -> None:
    """Start the data center: it trains the meta-model on the training robots' experience and sends it down.

    For a meta method it takes the experience of t0 rounds from the uplink and stays until every robot of the scenario
    has the meta-model; for fedavg and centralized it serves every round. CUDA is used where there is one.

    Example: python -m jouleswarm.datacenter --broker mqtt://localhost:1883 --scenario quick
    """
    with process("data center", verbose=verbose):
        # Late imports: --help and a wrong option answer at once, without PyTorch.
        from jouleswarm.common.bus.joining import Begun, join
        from jouleswarm.common.disk.state import Keep
        from jouleswarm.common.disk.verify import check_states
        from jouleswarm.common.errors import ConfigurationError, RunError, usable
        from jouleswarm.common.host import arithmetic
        from jouleswarm.common.scenario.reading import load_scenario

        settings = load_scenario(scenario, set_ or ())
        if not settings.needs_datacenter:
            raise ConfigurationError(f"scenario {scenario}: methods {settings.methods} need no data center")
        from jouleswarm.datacenter.center import run_datacenter
        from jouleswarm.learning.device import accelerator

        keep = Keep(state, durable, keep_state or keep_ends, keep_ends)
        begun = Begun(broker, keys, run, keep, other_processor)
        name, bus = join(settings, 0, begun, lambda: arithmetic(accelerator()), check_states)
        with usable("--state", state, RunError):
            run_datacenter(settings, name, bus, keep)


if __name__ == "__main__":
    app()
