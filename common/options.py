"""Command-line options that several processes share; each is an environment variable too."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from jouleswarm.common.disk.state import Keep

DEFAULT_BROKER = "mqtt://127.0.0.1:1883"
SCENARIO_HELP = "Scenario: a TOML file, or a name such as toy, quick or paper."

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
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", envvar="JOULESWARM_SET", help="Change the scenario: section.key=value. May be repeated."),
]
OtherProcessorOption = Annotated[
    bool,
    typer.Option(
        "--other-processor",
        envvar="JOULESWARM_OTHER_PROCESSOR",
        help="Go on although it was begun on another processor or build of PyTorch: weights may differ in their bits.",
    ),
]


@dataclass(frozen=True)
class Started:
    """What every robot and data center is started with."""

    scenario: Annotated[Path, typer.Option(envvar="JOULESWARM_SCENARIO", help=SCENARIO_HELP)]
    broker: BrokerOption = DEFAULT_BROKER
    keys: KeysOption = None
    run: Annotated[
        str | None, typer.Option(envvar="JOULESWARM_RUN", help="Name of the run on the bus. Default: the scenario's.")
    ] = None
    state: Annotated[
        Path | None,
        typer.Option(
            envvar="JOULESWARM_STATE",
            help="Folder to remember each round in: a process that was killed goes on from it.",
        ),
    ] = None
    durable: Annotated[
        bool,
        typer.Option(
            "--durable",
            envvar="JOULESWARM_DURABLE",
            help="Have each round in the --state folder on the disk: slower, and "
            "safe from a power failure, not only from being killed.",
        ),
    ] = False
    keep_state: Annotated[
        bool,
        typer.Option("--keep-state", envvar="JOULESWARM_KEEP_STATE", help="Leave the --state folder at the end too."),
    ] = False
    keep_ends: Annotated[
        bool,
        typer.Option(
            "--keep-ends",
            envvar="JOULESWARM_KEEP_ENDS",
            help="Keep in the --state folder how each arm ends: started again with more rounds "
            "(federation.max_rounds, target_reward) it goes on from there.",
        ),
    ] = False
    other_processor: OtherProcessorOption = False
    set_: SetOption = None
    quiet: Annotated[bool, typer.Option("--quiet", envvar="JOULESWARM_QUIET", help="Print no line a round.")] = False
    verbose: Annotated[bool, typer.Option(envvar="JOULESWARM_VERBOSE", help="Say what is waited for.")] = True

    @property
    def keep(self) -> Keep:
        """What is kept on disk to go on from."""
        from jouleswarm.common.disk.state import Keep

        return Keep(self.state, self.durable, self.keep_state or self.keep_ends, self.keep_ends)


def with_started(body: Callable[..., None]) -> Callable[..., None]:
    """`body(started, ...)` as a function with an option for each field of `Started`, for Typer, after its own."""
    shared = inspect.signature(Started, eval_str=True).parameters
    own = list(inspect.signature(body, eval_str=True).parameters.values())[1:]

    def main(**given: Any) -> None:
        started = Started(**{name: given.pop(name) for name in shared})
        body(started, **given)

    parameters = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in (*own, *shared.values())]
    main.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    main.__annotations__ = {each.name: each.annotation for each in parameters}
    main.__doc__ = body.__doc__
    return main
