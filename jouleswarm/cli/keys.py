"""The command line of keys: `jouleswarm keys init` and `jouleswarm keys remove`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jouleswarm.cli.options import ScenarioFile
from jouleswarm.common.invoked import executable, python
from jouleswarm.common.options import SetOption

keys = typer.Typer(no_args_is_help=True, help="Keys for a broker that lets in only who may come, over TLS.")


@keys.command()
def init(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="The folder to make; it must not be there yet.")] = Path("keys"),
    hosts: Annotated[
        str, typer.Option(help="Host names and addresses that clients reach the broker by, with commas between.")
    ] = "localhost,127.0.0.1,::1",
    days: Annotated[int, typer.Option(min=1, help="Days that the certificates hold.")] = 365,
    set_: SetOption = None,
    refresh: Annotated[
        bool, typer.Option("--refresh", help="Leave a folder of keys that still serves this scenario; replace another.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Give no advice on what to type next.")] = False,
) -> None:
    """Make certificates, passwords and topic rights for every client of a scenario.

    \b
    FOLDER/ca.crt, ca.key  the authority that signs all certificates; keep
                           ca.key, or delete it
    FOLDER/broker/         for the broker: its certificate, users with argon2id
                           hashes, rights
    FOLDER/agent-1/ ...    for one client each: certificate, password, ca.crt;
                           nobody else needs it

    A robot on another machine gets FOLDER/agent-N/ alone, into a folder of keys there. Private files can be read
    by their owner only. A client's name is its user, its id on the bus and the common name of its certificate.

    \b
    Example:
      jouleswarm keys init quick --out keys --hosts broker.example,127.0.0.1
      python -m jouleswarm.broker --host 0.0.0.0 --keys keys
      python -m jouleswarm.agents --id 1 --scenario quick --keys keys \\
          --broker mqtts://broker.example:8883
    """
    from jouleswarm.common.scenario.reading import load_scenario
    from jouleswarm.fleet.keys import make_keys, refresh_keys

    settings, names = load_scenario(scenario, set_ or ()), [host.strip() for host in hosts.split(",")]
    clients = (refresh_keys if refresh else make_keys)(settings, out, names, days)
    if clients is None:
        print(f"{out} is there already and serves {scenario}")
        return
    there = f"--keys {out} --broker mqtts://{names[0]}:8883"
    print(
        f"{out}: certificates for {days} days (the broker's for {', '.join(names)}), passwords and rights of "
        f"{len(clients)} clients:\n"
        f"  {', '.join(clients)}"
    )
    if quiet:
        return
    print(
        "Next, all on this machine:\n"
        f"  {executable()} run {scenario} --keys {out}\n"
        "or process by process:\n"
        f"  {python()} -m jouleswarm.broker --keys {out}\n"
        f"  {executable()} record {scenario} {there}\n"
        f"  {python()} -m jouleswarm.datacenter --scenario {scenario} {there}\n"
        f"  {python()} -m jouleswarm.agents --id 1 --scenario {scenario} {there}"
    )


@keys.command()
def remove(
    clients: Annotated[list[str], typer.Argument(metavar="NAME...", help="Clients to take out, such as agent-3.")],
    out: Annotated[Path, typer.Option(help="The folder of keys, where the broker reads it.")] = Path("keys"),
) -> None:
    """Take clients out of a folder of keys: the broker lets them in no more, whatever they still hold.

    A broker that is running ends their connections when it hears SIGHUP, and goes on for all others.

    \b
    Example:
      jouleswarm keys remove agent-3 --out keys
      kill -HUP PROCESS    # of the broker
    """
    from jouleswarm.fleet.keys import remove_keys

    remove_keys(out, clients)
    print(
        f"{out}: {', '.join(clients)} taken out, keys and all. A broker that is running goes by it from SIGHUP on:\n"
        "  kill -HUP PROCESS"
    )
