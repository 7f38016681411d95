"""`jouleswarm meter`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jouleswarm.cli.options import EnergyFile, EnergyOption, Out, RunId

if TYPE_CHECKING:
    from jouleswarm.common.meter.tally import Row
    from jouleswarm.metering.serve import Recorder

Links = Annotated[Path, typer.Option(metavar="FILE", help="Rules: topic filters and their links (TOML).")]
Listen = Annotated[str, typer.Option(metavar="HOST:PORT", help="Where clients connect; :PORT is every address.")]

meter = typer.Typer(no_args_is_help=True, help="Count the bytes of any MQTT application, to be priced in joules.")


@meter.command()
def proxy(
    to: Annotated[str, typer.Option(metavar="URL", help="The broker: mqtt://HOST:PORT, or mqtts:// for TLS.")],
    links: Links,
    listen: Listen = "127.0.0.1:1884",
    out: Out = Path("runs"),
    run_id: RunId = None,
    cert: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Certificate (PEM) to show to clients: TLS ends here.")
    ] = None,
    key: Annotated[Path | None, typer.Option(metavar="FILE", help="Its private key (PEM).")] = None,
    ca: Annotated[
        Path | None, typer.Option(metavar="FILE", help="CA (PEM) to trust the broker by; default: the system's.")
    ] = None,
) -> None:
    """Meter what passes between clients and a broker that is not ours, whatever it is: MQTT 3.1, 3.1.1 and 5.

    \b
    Say in links.toml which topics go over which link; the first rule that matches counts:
        "fed/+round/+client/up" = { link = "uplink" }
        "fed/+round/model"      = { link = "downlink" }
        "peers/+sender/weights" = { link = "sidelink" }
    Then have your clients connect to the proxy in place of the broker:
        jouleswarm meter proxy --to mqtt://127.0.0.1:1883 --links links.toml
        mosquitto_pub -p 1884 -t fed/1/robot-3/up -m hello
    Ctrl-C ends it, shows what was counted, and leaves RUN/meter.jsonl and RUN/bill.csv:
        jouleswarm bill runs/RUN/bill.csv

    Bytes are passed on as they come, and only counted: a stream that is not MQTT goes through as it is, and is counted
    as such. What no rule matches is counted as `other`. docs/meter.md has all that a rule can say.
    """
    import asyncio

    from jouleswarm.common.bus.address import parse_url
    from jouleswarm.common.meter.tally import Tally
    from jouleswarm.metering.proxy import Proxy, client_tls, server_tls, without_user
    from jouleswarm.metering.serve import Recorder, make_folder, parse_listen, serve

    where, broker = parse_listen(listen), without_user(parse_url(to))
    made = Proxy(broker, Tally(), server_tls(cert, key), client_tls(broker, ca))
    folder = make_folder(out, run_id, links)
    recorder = Recorder(folder, links, made.tally.counts)

    def tell(port: int) -> None:
        typer.echo(f"listening on {where[0] or ''}:{port} for {broker}; Ctrl-C ends, counts go to {folder}")

    _show(links, folder, recorder, asyncio.run(serve(made, where, recorder, tell)))


@meter.command()
def serve(
    links: Links,
    listen: Listen = "127.0.0.1:1883",
    out: Out = Path("runs"),
    run_id: RunId = None,
    options: Annotated[
        list[str] | None, typer.Argument(metavar="-- OPTIONS", help="Of the broker, as `python -m broker --help` has.")
    ] = None,
) -> None:
    """Be the broker of any MQTT 3.1.1 application, and meter all that passes.

    \b
    Say in links.toml which topics go over which link; the first rule that matches counts:
        "fed/+round/+client/up" = { link = "uplink" }
        "peers/+sender/#rest"   = [{ link = "uplink", receiver = "server*" }, { link = "sidelink" }]
    Then start the broker, and have your clients connect to it:
        jouleswarm meter serve --links links.toml
        jouleswarm meter serve --links links.toml --listen :8883 -- --keys keys
    Ctrl-C ends it, shows what was counted, and leaves RUN/meter.jsonl and RUN/bill.csv:
        jouleswarm bill runs/RUN/bill.csv

    SIGHUP has the rules read anew, for what was counted before too. Who sends and who receives is told by client id, or
    by user where the broker has users (--keys). docs/meter.md has all that a rule can say.
    """
    import asyncio

    from jouleswarm.fleet.meter_broker import MeterBroker, check_address, forget, meter_broker
    from jouleswarm.metering.serve import Recorder, ending, make_folder, parse_listen

    where = parse_listen(listen)
    check_address(where)
    folder = make_folder(out, run_id, links)

    async def metered(broker: MeterBroker, recorder: Recorder) -> None:
        def read_anew() -> None:
            if recorder.read_rules():
                broker.go_by(links)

        await recorder.record(ending(read_anew), broker.check)

    with meter_broker(folder, links, where, options or (), typer.echo) as broker:
        metrics = f", metrics at {broker.metrics}" if broker.metrics else ""
        typer.echo(f"broker at {broker.url}{metrics}; Ctrl-C ends, counts go to {folder}")
        recorder = Recorder(folder, links, broker.counts)
        asyncio.run(metered(broker, recorder))
    rows = asyncio.run(recorder.end())
    forget(folder)
    _show(links, folder, recorder, rows)


def _show(links: Path, folder: Path, recorder: Recorder, rows: list[Row]) -> None:
    from rich.console import Console

    from jouleswarm.metering.written import unmatched
    from jouleswarm.report.metered import metered_table
    from jouleswarm.report.table import show

    never = unmatched(rows, recorder.rules)
    told = [f"{links}, line {rule.line}, {rule.text} ({rule.priced.link})" for rule in never]
    show(metered_table(rows, told), Console())
    typer.echo(f"price it: jouleswarm bill {folder / 'bill.csv'}")


@meter.command()
def watch(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="What the meter writes to.")],
    energy: EnergyFile = None,
    set_: EnergyOption = None,
    once: Annotated[bool, typer.Option("--once", help="Show it once, and end.")] = False,
) -> None:
    """Show who moves most, by link and topic, and what it costs; anew every two seconds, until Ctrl-C.

    \b
    Dearest first, at the paper's prices or at your own:
        jouleswarm meter watch runs/RUN
        jouleswarm meter watch runs/RUN --set energy.ul_bit_per_j=500e3
    """
    from jouleswarm.report.metered import watch as show

    show(folder, energy, set_ or (), once=once)
