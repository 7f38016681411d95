"""`python -m broker`."""

from __future__ import annotations

import asyncio
import json
import logging
from dataclasses import asdict

import typer

from jouleswarm.broker.lines import LOG
from jouleswarm.broker.logs import background_log
from jouleswarm.broker.options import Options, command
from jouleswarm.broker.protection import protection_of, warning_of
from jouleswarm.broker.server import Addresses, Settings, run
from jouleswarm.common.bus.address import DEFAULT_PORT, DEFAULT_TLS_PORT
from jouleswarm.common.errors import usable
from jouleswarm.common.process import one_line_errors

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


def main(options: Options) -> None:
    """An MQTT 3.1.1 broker that counts every byte, by run, arm, link class, topic and client.

    Subscribe to $SYS/jouleswarm/meter for its totals and $SYS/jouleswarm/limits for the largest message it takes;
    docs/broker.md says how to ask for all rows of a run. Ctrl-C ends it.

    Example: python -m jouleswarm.broker --port 1883

    Of any other application it counts what rules (docs/meter.md) say, and tells it when it ends: --links links.toml.

    With users, TLS and topic rights: jouleswarm keys init quick --out keys --hosts HOST,127.0.0.1, then
    python -m jouleswarm.broker --host 0.0.0.0 --keys keys
    """
    level = _level(options.log_level)
    with one_line_errors("broker"), background_log(level):
        tls, guard = protection_of(options)
        warning = warning_of(options.host, with_tls=tls is not None, with_users=guard is not None)
        settings = Settings(
            host=options.host,
            port=(DEFAULT_PORT if tls is None else DEFAULT_TLS_PORT) if options.port is None else options.port,
            metrics_port=options.metrics_port if options.metrics else None,
            metering=options.meter,
            links=options.links,
            exit_with_stdin=options.exit_with_stdin,
            limits=options.limits,
            tls=tls,
            state=options.state,
        )

        is_watched = not options.quiet and not options.exit_with_stdin
        logging.getLogger(LOG).setLevel(logging.INFO if is_watched else logging.CRITICAL)

        def ready(addresses: Addresses) -> None:
            if warning:
                typer.echo(f"broker: {warning}", err=True)
            (_announce_json if options.exit_with_stdin else _announce)(addresses)

        with usable("--state", options.state):
            by_rule = asyncio.run(run(settings, ready, guard))
        if by_rule is not None and not options.exit_with_stdin:
            for line in by_rule.told():
                typer.echo(line)


def _level(log_level: str) -> int:
    level = logging.getLevelNamesMapping().get(log_level.upper())
    if level is None:
        raise typer.BadParameter(f"got {log_level}, expected DEBUG, INFO, WARNING or ERROR", param_hint="--log-level")
    return level


def _announce_json(addresses: Addresses) -> None:
    print(json.dumps(asdict(addresses)), flush=True)


def _announce(addresses: Addresses) -> None:
    metrics = f", metrics at {addresses.metrics}" if addresses.metrics else ""
    print(f"Broker at {addresses.url}{metrics}. Ctrl-C ends it.", flush=True)


app.command()(command(main))

if __name__ == "__main__":
    app()
