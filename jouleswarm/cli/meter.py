"""`jouleswarm meter`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from jouleswarm.cli.options import EnergyFile, EnergyOption, Out, RunId
from jouleswarm.common.invoked import executable

meter = typer.Typer(no_args_is_help=True, help="Count the bytes of any MQTT application, to be priced in joules.")


@meter.command()
def proxy(
    to: Annotated[str, typer.Option(metavar="URL", help="The broker: mqtt://HOST:PORT, or mqtts:// for TLS.")],
    links: Annotated[Path, typer.Option(metavar="FILE", help="Rules: topic filters and their links (TOML).")],
    listen: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Where clients connect; :PORT is every address.")
    ] = "127.0.0.1:1884",
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
    Say in links.toml which topics go over which link; the first rule that
    matches counts:
        "fed/+round/+client/up" = { link = "uplink" }
        "fed/+round/model"      = { link = "downlink" }
        "peers/+sender/weights" = { link = "sidelink" }
    Then have your clients connect to the proxy in place of the broker:
        jouleswarm meter proxy --to mqtt://127.0.0.1:1883 --links links.toml
        mosquitto_pub -p 1884 -t fed/1/robot-3/up -m hello
    Ctrl-C ends it, shows what was counted, and leaves RUN/meter.jsonl and
    RUN/bill.csv:
        jouleswarm bill runs/RUN/bill.csv

    Bytes are passed on as they come, and only counted: a stream that is not MQTT goes through as it is, and is counted
    as such. What no rule matches is counted as `other`. docs/meter.md has all that a rule can say.
    """
    import asyncio

    from rich.console import Console

    from jouleswarm.common.bus.address import parse_url
    from jouleswarm.common.wire.rules import read_rules
    from jouleswarm.metering.proxy import Proxy, client_tls, server_tls, without_user
    from jouleswarm.metering.serve import make_folder, parse_listen, serve
    from jouleswarm.metering.tally import Tally
    from jouleswarm.metering.written import unmatched
    from jouleswarm.report.metered import metered_table
    from jouleswarm.report.table import show

    where, broker, rules = parse_listen(listen), without_user(parse_url(to)), read_rules(links)
    made = Proxy(broker, Tally(), server_tls(cert, key), client_tls(broker, ca))
    folder = make_folder(out, run_id, links)

    def tell(port: int) -> None:
        typer.echo(f"listening on {where[0] or ''}:{port} for {broker}; Ctrl-C ends, counts go to {folder}")

    rows = asyncio.run(serve(made, where, folder, rules, tell))
    never = [f"{links}, line {rule.line}, {rule.text} ({rule.priced.link})" for rule in unmatched(rows, rules)]
    show(metered_table(rows, never), Console())
    typer.echo(f"price it: {executable()} bill {shlex.quote(str(folder / 'bill.csv'))}")


@meter.command()
def watch(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="What `jouleswarm meter proxy` writes to.")],
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
