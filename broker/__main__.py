"""`python -m broker`."""

from __future__ import annotations

import asyncio
import json
import logging
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from jouleswarm.broker.limits import MEGABYTE, Limits
from jouleswarm.broker.protection import protection_of, warning_of
from jouleswarm.broker.server import Addresses, Settings, run
from jouleswarm.common.bus.address import DEFAULT_PORT, DEFAULT_TLS_PORT
from jouleswarm.common.errors import usable
from jouleswarm.common.process import one_line_errors

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


def _env(name: str) -> str:
    return f"JOULESWARM_BROKER_{name}"


def _file(name: str, what: str) -> Any:
    return typer.Option(envvar=_env(name), metavar="FILE", help=what)


@app.command()
def main(
    host: Annotated[str, typer.Option(envvar=_env("HOST"), help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[
        int | None,
        typer.Option(
            min=0, max=65535, envvar=_env("PORT"), help="MQTT port; 0 picks a free one. [default: 1883; with TLS 8883]"
        ),
    ] = None,
    keys: Annotated[
        Path | None,
        typer.Option(
            envvar="JOULESWARM_KEYS", metavar="FOLDER", help="Folder of keys: stands for the five options below."
        ),
    ] = None,
    tls_cert: Annotated[Path | None, _file("TLS_CERT", "Certificate to show (PEM): TLS only from then on.")] = None,
    tls_key: Annotated[Path | None, _file("TLS_KEY", "Its private key (PEM).")] = None,
    tls_client_ca: Annotated[
        Path | None, _file("TLS_CLIENT_CA", "Let in only clients with a certificate signed by this CA (PEM).")
    ] = None,
    users: Annotated[
        Path | None, _file("USERS", "Users: lines NAME:HASH, argon2id. A client's id must be its user's name.")
    ] = None,
    rights: Annotated[
        Path | None, _file("RIGHTS", "What each user may publish and read, as in Mosquitto's acl_file.")
    ] = None,
    metrics_port: Annotated[
        int, typer.Option(min=0, max=65535, envvar=_env("METRICS_PORT"), help="Prometheus port; 0 = a free one.")
    ] = 9883,
    metrics: Annotated[bool, typer.Option(envvar=_env("METRICS"), help="Serve Prometheus metrics.")] = True,
    meter: Annotated[bool, typer.Option(envvar=_env("METER"), help="Count messages and bytes.")] = True,
    max_message_mb: Annotated[
        int, typer.Option(min=1, max=255, envvar=_env("MAX_MESSAGE_MB"), help="Largest packet taken, MiB.")
    ] = 64,
    memory_mb: Annotated[
        int,
        typer.Option(
            min=1,
            envvar=_env("MEMORY_MB"),
            help="Stop reading from publishers while more than this, MiB, waits for subscribers.",
        ),
    ] = 192,
    max_connections: Annotated[
        int, typer.Option(min=1, envvar=_env("MAX_CONNECTIONS"), help="Connections at one time.")
    ] = 1000,
    connect_timeout_s: Annotated[
        float, typer.Option(min=0.1, envvar=_env("CONNECT_TIMEOUT_S"), help="Time a new connection has to CONNECT.")
    ] = 10.0,
    stall_timeout_s: Annotated[
        float,
        typer.Option(
            min=0.1,
            envvar=_env("STALL_TIMEOUT_S"),
            help="Drop a client that takes nothing of what is queued for it for this long.",
        ),
    ] = 60.0,
    pressed_stall_timeout_s: Annotated[
        float,
        typer.Option(
            min=0.1,
            envvar=_env("PRESSED_STALL_TIMEOUT_S"),
            help="The same for one that holds more than its share of the memory while publishers wait for room.",
        ),
    ] = 10.0,
    max_retained_mb: Annotated[
        int, typer.Option(min=1, envvar=_env("MAX_RETAINED_MB"), help="Retained messages together, MiB.")
    ] = 64,
    max_subscriptions: Annotated[
        int, typer.Option(min=1, envvar=_env("MAX_SUBSCRIPTIONS"), help="Topic filters of one client.")
    ] = 5000,
    max_name_length: Annotated[
        int,
        typer.Option(min=16, envvar=_env("MAX_NAME_LENGTH"), help="Length of a topic, a topic filter or a client id."),
    ] = 1024,
    max_offline_sessions: Annotated[
        int,
        typer.Option(
            min=1, envvar=_env("MAX_OFFLINE_SESSIONS"), help="Persistent sessions kept whose clients are away."
        ),
    ] = 1000,
    session_expiry_s: Annotated[
        int, typer.Option(min=1, envvar=_env("SESSION_EXPIRY_S"), help="Keep a persistent session that is away.")
    ] = 3600,
    state: Annotated[
        Path | None,
        typer.Option(envvar=_env("STATE"), help="Folder to keep the counters in: a broker that was killed goes on."),
    ] = None,
    exit_with_stdin: Annotated[
        bool,
        typer.Option(
            "--exit-with-stdin",
            envvar=_env("EXIT_WITH_STDIN"),
            help="For launchers: print the addresses as one line of JSON, ignore Ctrl-C, end when stdin closes.",
        ),
    ] = False,
    log_level: Annotated[
        str, typer.Option(envvar=_env("LOG_LEVEL"), help="DEBUG, INFO, WARNING or ERROR; to stderr.")
    ] = "WARNING",
) -> None:
    """An MQTT 3.1.1 broker that counts every byte, by run, arm, link class, topic and client.

    Subscribe to $SYS/jouleswarm/meter for its totals and $SYS/jouleswarm/limits for the largest message it takes;
    docs/broker.md says how to ask for all rows of a run. Ctrl-C ends it.

    Example: python -m jouleswarm.broker --port 1883

    With users, TLS and topic rights: jouleswarm keys init quick --out keys --hosts HOST,127.0.0.1, then
    python -m jouleswarm.broker --host 0.0.0.0 --keys keys
    """
    level = logging.getLevelNamesMapping().get(log_level.upper())
    if level is None:
        raise typer.BadParameter(f"got {log_level}, expected DEBUG, INFO, WARNING or ERROR", param_hint="--log-level")
    logging.basicConfig(level=level, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    for name in ("amqtt", "transitions"):
        logging.getLogger(name).setLevel(max(level, logging.WARNING))
    limits = Limits(
        message_bytes=max_message_mb * MEGABYTE,
        memory_bytes=memory_mb * MEGABYTE,
        connections=max_connections,
        connect_timeout_s=connect_timeout_s,
        stall_timeout_s=stall_timeout_s,
        pressed_stall_timeout_s=pressed_stall_timeout_s,
        retained_bytes=max_retained_mb * MEGABYTE,
        subscriptions=max_subscriptions,
        name_length=max_name_length,
        offline_sessions=max_offline_sessions,
        session_expiry_s=session_expiry_s,
    )
    with one_line_errors("broker"):
        tls, guard = protection_of(keys, tls_cert, tls_key, tls_client_ca, users, rights, connect_timeout_s)
        warning = warning_of(host, with_tls=tls is not None, with_users=guard is not None)
        if port is None:
            port = DEFAULT_PORT if tls is None else DEFAULT_TLS_PORT
        settings = Settings(host, port, metrics_port if metrics else None, meter, exit_with_stdin, limits, tls, state)

        def ready(addresses: Addresses) -> None:
            if warning:
                typer.echo(f"broker: {warning}", err=True)
            (_announce_json if exit_with_stdin else _announce)(addresses)

        with usable("--state", state):
            asyncio.run(run(settings, ready, guard))


def _announce_json(addresses: Addresses) -> None:
    print(json.dumps(asdict(addresses)), flush=True)


def _announce(addresses: Addresses) -> None:
    metrics = f", metrics at {addresses.metrics}" if addresses.metrics else ""
    print(f"Broker at {addresses.url}{metrics}. Ctrl-C ends it.", flush=True)


if __name__ == "__main__":
    app()
