"""`python -m datacenter`: the data center."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from common.process import process, use_one_thread

app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.command()
def main(
    scenario: Annotated[Path, typer.Option(envvar="JOULESWARM_SCENARIO", help="Scenario file (TOML).")],
    broker: Annotated[
        str, typer.Option(envvar="JOULESWARM_BROKER", help="Where the broker is.")
    ] = "mqtt://127.0.0.1:1883",
    run: Annotated[
        str | None, typer.Option(envvar="JOULESWARM_RUN", help="Name of the run on the bus. Default: the scenario's.")
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(envvar="JOULESWARM_STATE", help="Folder for a checkpoint each round; resumes from one it holds."),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", envvar="JOULESWARM_SET", help="Change the scenario: section.key=value. May be repeated."),
    ] = None,
    verbose: Annotated[bool, typer.Option(envvar="JOULESWARM_VERBOSE", help="Say what is waited for.")] = True,
) -> None:
    """Start the data center: it trains the meta-model on the training robots' experience and sends it down.

    It takes the experience of t0 MAML rounds from the uplink, stays until every robot of the scenario has the
    meta-model, and ends. CUDA is used where there is one.

    Example: python -m datacenter --broker mqtt://localhost:1883 --scenario scenarios/quick.toml
    """
    with process("data center", verbose=verbose):
        # Late imports: --help and a wrong option answer at once.
        from common import topics
        from common.errors import ConfigurationError
        from common.mqtt import MqttBus
        from common.payloads import Presence, encode_json
        from common.scenario import load_scenario
        from datacenter.server import ARM, run_datacenter

        settings = load_scenario(scenario, set_ or ())
        if ARM not in settings.arms:
            raise ConfigurationError(f"scenario {scenario}: arms {settings.arms} need no data center")
        use_one_thread()
        name = topics.run_name(run or settings.name)
        bus = MqttBus.connect(
            broker,
            "datacenter",
            will=(topics.presence(name, 0, 0), encode_json(Presence(agent=0, state="gone"))),
            keepalive_s=settings.bus.keepalive_s,
            connect_timeout_s=settings.bus.connect_timeout_s,
        )
        run_datacenter(settings, name, bus, state)


if __name__ == "__main__":
    app(prog_name="python -m datacenter")
