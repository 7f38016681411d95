"""`python -m datacenter`: the data center."""

from __future__ import annotations

import typer

from jouleswarm.common.options import Started, with_started
from jouleswarm.common.process import process

app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)


@app.command()
@with_started
def main(started: Started) -> None:
    """Start the data center: it trains the meta-model on the training robots' experience and sends it down.

    For a meta method it takes the experience of t0 rounds from the uplink and stays until every robot of the scenario
    has the meta-model; for fedavg and centralized it serves every round. CUDA is used where there is one.

    Example: python -m jouleswarm.datacenter --broker mqtt://localhost:1883 --scenario quick
    """
    with process("data center", verbose=started.verbose, quiet=started.quiet):
        # Late imports: --help and a wrong option answer at once, without PyTorch.
        from jouleswarm.common.bus.joining import join
        from jouleswarm.common.disk.verify import check_states
        from jouleswarm.common.errors import ConfigurationError, RunError, usable
        from jouleswarm.common.host import arithmetic
        from jouleswarm.common.scenario.reading import load_scenario

        settings = load_scenario(started.scenario, started.set_ or ())
        if not settings.needs_datacenter:
            raise ConfigurationError(f"scenario {started.scenario}: methods {settings.methods} need no data center")
        from jouleswarm.datacenter.center import run_datacenter
        from jouleswarm.learning.device import accelerator

        name, bus = join(settings, 0, started, lambda: arithmetic(accelerator()), check_states)
        with usable("--state", started.state, RunError):
            run_datacenter(settings, name, bus, started.keep)


if __name__ == "__main__":
    app()
