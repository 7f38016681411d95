"""`jouleswarm meter`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from jouleswarm.cli.options import EnergyFile, EnergyOption, Out, RunId
from jouleswarm.common.invoked import executable

meter = typer.Typer(no_args_is_help=True, help="Count the bytes of any MQTT application, to be priced in joules.")

Links = Annotated[Path, typer.Option(metavar="FILE", help="Rules: topic filters and their links (TOML).")]
Listen = Annotated[str, typer.Option(metavar="HOST:PORT", help="Where clients connect; :PORT is every address.")]
Window = Annotated[
    float, typer.Option(metavar="SECONDS", min=2, max=86_400, help="Counts by time are of windows so long.")
]
Facts = Annotated[
    str | None,
    typer.Option(metavar="URL", help="Write down too what each `jouleswarm.Meter(broker=...)` tells there: mqtt://..."),
]
FactsToo = Annotated[
    bool, typer.Option("--facts", help="Write down too what each `jouleswarm.Meter(broker=...)` tells it.")
]
BrokerOptions = Annotated[
    list[str] | None, typer.Argument(metavar="-- OPTIONS", help="Of the broker, as `python -m broker --help` has.")
]
MetricsPort = Annotated[int | None, typer.Option(min=0, max=65_535, help="Serve Prometheus metrics; 0: a free port.")]
Certificate = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Certificate (PEM) to show to clients: TLS ends here.")
]
PrivateKey = Annotated[Path | None, typer.Option(metavar="FILE", help="Its private key (PEM).")]
Authority = Annotated[
    Path | None, typer.Option(metavar="FILE", help="CA (PEM) to trust the broker by; default: the system's.")
]


@meter.command()
def proxy(
    to: Annotated[str, typer.Option(metavar="URL", help="The broker: mqtt://HOST:PORT, or mqtts:// for TLS.")],
    links: Links,
    listen: Listen = "127.0.0.1:1884",
    out: Out = Path("runs"),
    run_id: RunId = None,
    facts: Facts = None,
    energy: EnergyFile = None,
    set_: EnergyOption = None,
    window: Window = 60,
    metrics_port: MetricsPort = None,
    cert: Certificate = None,
    key: PrivateKey = None,
    ca: Authority = None,
) -> None:
    """Meter what passes between clients and a broker that is not ours, whatever it is: MQTT 3.1, 3.1.1 and 5.

    \b
    Say in links.toml which topics go over which link; the first rule that
    matches counts:
        "fed/+round/+client/up" = { link = "uplink" }
        "fed/+round/model"      = { link = "downlink" }
        "peers/+sender/weights" = { link = "sidelink" }
    Then have your clients connect to the proxy in place of the broker:
        jouleswarm meter proxy --to mqtt://127.0.0.1:1883 --links links.toml
        mosquitto_pub -p 1884 -t fed/1/robot-3/up -m hello
    Ctrl-C ends it and shows the bill of what was counted. What it leaves is
    a run directory:
        jouleswarm report runs/RUN --set energy.ul_bit_per_j=500e3

    Bytes are passed on as they come, and only counted: a stream that is not MQTT goes through as it is, and is counted
    as such. What no rule matches is counted as `other`. docs/meter.md has all that a rule can say.
    """
    import asyncio

    from jouleswarm.common.bus.address import parse_url
    from jouleswarm.common.meter.tally import Tally
    from jouleswarm.metering.directory import Directory, folder_of
    from jouleswarm.metering.proxy import Proxy, client_tls, server_tls, without_user
    from jouleswarm.metering.recorder import Recorder
    from jouleswarm.metering.serve import parse_listen, serve
    from jouleswarm.metering.told import heard

    where, broker = parse_listen(listen), without_user(parse_url(to))
    made, folder = Proxy(broker, Tally(), server_tls(cert, key), client_tls(broker, ca)), folder_of(out, run_id)
    about = {"broker": {"embedded": False, "url": str(broker)}}
    with Directory(folder, links, energy, set_ or (), about) as directory:
        _export(folder, where[0], metrics_port)

        def tell(port: int) -> None:
            typer.echo(f"listening on {where[0] or ''}:{port} for {broker}; Ctrl-C ends, counts go to {folder}")

        with heard(facts, folder.name) as told:
            asyncio.run(serve(made, where, Recorder(directory, made.tally.counts, window, told), tell))
    _show(folder)


@meter.command()
def serve(
    links: Links,
    listen: Listen = "127.0.0.1:1883",
    out: Out = Path("runs"),
    run_id: RunId = None,
    facts: FactsToo = False,
    energy: EnergyFile = None,
    set_: EnergyOption = None,
    window: Window = 60,
    options: BrokerOptions = None,
) -> None:
    """Be the broker of any MQTT 3.1.1 application, and meter all that passes.

    \b
    Say in links.toml which topics go over which link; the first rule that
    matches counts:
        "fed/+round/+client/up" = { link = "uplink" }
        "peers/+sender/#rest"   = [{ link = "uplink", receiver = "server*" },
                                   { link = "sidelink" }]
    Then start the broker, and have your clients connect to it:
        jouleswarm meter serve --links links.toml
        jouleswarm meter serve --links links.toml -- --keys keys
    Ctrl-C ends it and shows the bill of what was counted. What it leaves is
    a run directory:
        jouleswarm report runs/RUN --set energy.ul_bit_per_j=500e3

    SIGHUP has the rules read anew, for what was counted before too. Who sends and who receives is told by client id, or
    by user where the broker has users (--keys). docs/meter.md has all that a rule can say.
    """
    import asyncio

    from jouleswarm.fleet.meter_broker import MeterBroker, check_address, forget, meter_broker
    from jouleswarm.metering.directory import Directory, folder_of
    from jouleswarm.metering.recorder import Recorder
    from jouleswarm.metering.serve import ending, parse_listen
    from jouleswarm.metering.told import heard

    where, folder = parse_listen(listen), folder_of(out, run_id)
    check_address(where)

    async def metered(broker: MeterBroker, recorder: Recorder) -> None:
        def read_anew() -> None:
            if recorder.read_rules():
                broker.go_by(links)

        await recorder.record(ending(read_anew), broker.check)

    with Directory(folder, links, energy, set_ or (), {"broker": {"embedded": True}}) as directory:
        with meter_broker(folder, links, where, options or (), typer.echo) as broker:
            metrics = f", metrics at {broker.metrics}" if broker.metrics else ""
            typer.echo(f"broker at {broker.url}{metrics}; Ctrl-C ends, counts go to {folder}")
            with heard(broker.url if facts else None, folder.name) as told:
                recorder = Recorder(directory, broker.counts, window, told)
                asyncio.run(metered(broker, recorder))
        asyncio.run(recorder.end())
        forget(folder)
    _show(folder)


def _export(folder: Path, host: str | None, port: int | None) -> None:
    if port is None:
        return
    from jouleswarm.metering.exporter import start_exporter
    from jouleswarm.metering.metered import load_metered

    typer.echo(f"metrics at http://{host or ''}:{start_exporter(lambda: load_metered(folder), host, port)}/metrics")


def _show(folder: Path) -> None:
    from jouleswarm.report.report import report

    report(folder, html=True)
    typer.echo(
        f"run directory: {folder}\nother prices: {executable()} report {shlex.quote(str(folder))} --ul 500 --sl 200"
    )


@meter.command()
def watch(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="What the meter writes to.")],
    energy: EnergyFile = None,
    set_: EnergyOption = None,
    by: Annotated[
        str | None, typer.Option(metavar="WHAT", help="client, phase, or a label of the rules: +round.")
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Show it once, and end.")] = False,
) -> None:
    """Show who moves most, by link and topic, and what it costs; anew every two seconds, until Ctrl-C.

    \b
    Dearest first, at the meter's prices or at others:
        jouleswarm meter watch runs/RUN
        jouleswarm meter watch runs/RUN --set energy.ul_bit_per_j=500e3
        jouleswarm meter watch runs/RUN --by +round
    """
    from jouleswarm.cli.options import must_exist

    must_exist("what `jouleswarm meter` writes:", folder / "manifest.json")
    from jouleswarm.report.metered import watch as show

    show(folder, energy, set_ or (), by=by, once=once)
