"""`python -m datacenter`: the data center."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jouleswarm.common.allocator import keep_freed_memory
from jouleswarm.common.options import (
    DEFAULT_BROKER,
    BrokerOption,
    DurableOption,
    KeepStateOption,
    KeysOption,
    OtherProcessorOption,
    RunOption,
    ScenarioOption,
    SetOption,
    VerboseOption,
)
from jouleswarm.common.process import process, use_one_thread

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
        # Late imports: --help and a wrong option answer at once.
        from jouleswarm.common.bus.credentials import credentials_of
        from jouleswarm.common.bus.mqtt import MqttBus
        from jouleswarm.common.disk.lock import Lock
        from jouleswarm.common.disk.state import Keep
        from jouleswarm.common.disk.verify import check_states
        from jouleswarm.common.errors import ConfigurationError, RunError, usable
        from jouleswarm.common.host import arithmetic, same_arithmetic
        from jouleswarm.common.meter.meter import Meter
        from jouleswarm.common.scenario.scenario import load_scenario
        from jouleswarm.common.wire import topics
        from jouleswarm.common.wire.messages import Presence, encode_json
        from jouleswarm.datacenter.center import run_datacenter
        from jouleswarm.learning.device import accelerator

        settings = load_scenario(scenario, set_ or ())
        if not settings.needs_datacenter:
            raise ConfigurationError(f"scenario {scenario}: methods {settings.methods} need no data center")
        if state is not None:
            Lock(state, "data center")  # until the process ends
            check_states(state)
        use_one_thread()
        same_arithmetic(state, arithmetic(accelerator()), other_processor=other_processor)
        keep_freed_memory()
        name = topics.run_name(run or settings.name)
        with usable("--state", state):
            meter = Meter("client", state)
        bus = MqttBus.connect(
            broker,
            "datacenter",
            credentials=credentials_of(keys, "datacenter"),
            will=(topics.presence(name, 0, 0), encode_json(Presence(agent=0, state="gone"))),
            keepalive_s=settings.bus.keepalive_s,
            connect_timeout_s=settings.bus.connect_timeout_s,
            meter=meter,
        )
        with usable("--state", state, RunError):
            run_datacenter(settings, name, bus, Keep(state, durable, keep_state))


if __name__ == "__main__":
    app()
