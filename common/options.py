"""Command-line options that several processes share; each is an environment variable too."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

DEFAULT_BROKER = "mqtt://127.0.0.1:1883"
SCENARIO_HELP = "Scenario: a TOML file, or a name such as toy, quick or paper."

ScenarioOption = Annotated[Path, typer.Option(envvar="JOULESWARM_SCENARIO", help=SCENARIO_HELP)]
BrokerOption = Annotated[
    str, typer.Option(envvar="JOULESWARM_BROKER", help="Where the broker is: mqtt://HOST:PORT, or mqtts:// (TLS).")
]
KeysOption = Annotated[
    Path | None,
    typer.Option(
        "--keys",
        envvar="JOULESWARM_KEYS",
        metavar="FOLDER",
        help="Folder of keys (`jouleswarm keys init`): user, password and certificates are taken from it.",
    ),
]
RunOption = Annotated[
    str | None, typer.Option(envvar="JOULESWARM_RUN", help="Name of the run on the bus. Default: the scenario's.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", envvar="JOULESWARM_SET", help="Change the scenario: section.key=value. May be repeated."),
]
VerboseOption = Annotated[bool, typer.Option(envvar="JOULESWARM_VERBOSE", help="Say what is waited for.")]
KeepStateOption = Annotated[
    bool, typer.Option("--keep-state", envvar="JOULESWARM_KEEP_STATE", help="Leave the --state folder at the end too.")
]
KeepEndsOption = Annotated[
    bool,
    typer.Option(
        "--keep-ends",
        envvar="JOULESWARM_KEEP_ENDS",
        help="Keep in the --state folder how each arm ends: started again with more rounds "
        "(federation.max_rounds, target_reward) it goes on from there.",
    ),
]
OtherProcessorOption = Annotated[
    bool,
    typer.Option(
        "--other-processor",
        envvar="JOULESWARM_OTHER_PROCESSOR",
        help="Go on although it was begun on another processor or build of PyTorch: weights may differ in their bits.",
    ),
]
DurableOption = Annotated[
    bool,
    typer.Option(
        "--durable",
        envvar="JOULESWARM_DURABLE",
        help="Have each round in the --state folder on the disk: slower, and "
        "safe from a power failure, not only from being killed.",
    ),
]
