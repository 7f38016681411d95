"""`python -m datacenter`: the data center."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from common.memory import keep_freed_memory
from common.options import (
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
from common.process import process, use_one_thread

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

    Example: python -m datacenter --broker mqtt://localhost:1883 --scenario scenarios/quick.toml
    """
    with process("data center", verbose=verbose):
        # Late imports: --help and a wrong option answer at once.
        from common import topics
        from common.errors import ConfigurationError, RunError, usable
        from common.host import arithmetic, same_arithmetic
        from common.keys import credentials_of
        from common.lock import Lock
        from common.meter import Meter
        from common.mqtt import MqttBus
        from common.payloads import Presence, encode_json
        from common.scenario import load_scenario
        from common.state import Keep
        from common.verify import check_states
        from datacenter.device import accelerator
        from datacenter.server import run_datacenter

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
    app(prog_name="python -m datacenter")
