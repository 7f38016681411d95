"""Options of `python -m broker`, each with its bounds and environment variable, as one model."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import annotated_types
import typer
from pydantic import BaseModel, ConfigDict, Field
from pydantic.fields import FieldInfo

from jouleswarm.broker.limits import MEGABYTE, Limits

_PREFIX = "JOULESWARM_BROKER_"
_FILE: dict[str, Any] = {"metavar": "FILE"}
_FOLDER: dict[str, Any] = {"metavar": "FOLDER", "envvar": "JOULESWARM_KEYS"}
_ONE_WAY: dict[str, Any] = {"flag": "--exit-with-stdin"}  # no --no-exit-with-stdin


class Options(BaseModel):
    """What a broker process is started with; sizes in MiB, times in seconds."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    host: str = Field("127.0.0.1", description="Address to listen on.")
    port: int | None = Field(
        None, ge=0, le=65535, description="MQTT port; 0 picks a free one. [default: 1883; with TLS 8883]"
    )
    keys: Path | None = Field(
        None, json_schema_extra=_FOLDER, description="Folder of keys: stands for the five options below."
    )
    tls_cert: Path | None = Field(
        None, json_schema_extra=_FILE, description="Certificate to show (PEM): TLS only from then on."
    )
    tls_key: Path | None = Field(None, json_schema_extra=_FILE, description="Its private key (PEM).")
    tls_client_ca: Path | None = Field(
        None,
        json_schema_extra=_FILE,
        description="Let in only clients with a certificate signed by this CA (PEM).",
    )
    users: Path | None = Field(
        None,
        json_schema_extra=_FILE,
        description="Users: lines NAME:HASH, argon2id. A client's id must be its user's name. SIGHUP reads them anew.",
    )
    rights: Path | None = Field(
        None,
        json_schema_extra=_FILE,
        description="What each user may publish and read, as in Mosquitto's acl_file; read anew too.",
    )
    metrics_port: int = Field(9883, ge=0, le=65535, description="Prometheus port; 0 = a free one.")
    metrics: bool = Field(True, description="Serve Prometheus metrics.")
    meter: bool = Field(True, description="Count messages and bytes.")
    links: Path | None = Field(
        None,
        json_schema_extra=_FILE,
        description="Rules from topics to links (TOML): count any application's bytes by them; SIGHUP reads them anew.",
    )
    max_message_mb: int = Field(64, ge=1, le=255, description="Largest packet taken, MiB.")
    memory_mb: int = Field(
        192, ge=1, description="Stop reading from publishers while more than this, MiB, waits for subscribers."
    )
    max_connections: int = Field(1000, ge=1, description="Connections at one time.")
    connect_timeout_s: float = Field(10.0, ge=0.1, description="Time a new connection has to CONNECT.")
    stall_timeout_s: float = Field(
        60.0, ge=0.1, description="Drop a client that takes nothing of what is queued for it for this long."
    )
    pressed_stall_timeout_s: float = Field(
        10.0,
        ge=0.1,
        description="The same for one that holds more than its share of the memory while publishers wait for room.",
    )
    max_retained_mb: int = Field(64, ge=1, description="Retained messages together, MiB.")
    max_subscriptions: int = Field(5000, ge=1, description="Topic filters of one client.")
    max_name_length: int = Field(1024, ge=16, description="Length of a topic, a topic filter or a client id.")
    max_offline_sessions: int = Field(1000, ge=1, description="Persistent sessions kept whose clients are away.")
    session_expiry_s: int = Field(3600, ge=1, description="Keep a persistent session that is away.")
    state: Path | None = Field(None, description="Folder to keep the counters in: a broker that was killed goes on.")
    exit_with_stdin: bool = Field(
        False,
        json_schema_extra=_ONE_WAY,
        description="For launchers: print the addresses as one line of JSON, ignore Ctrl-C, end when stdin closes.",
    )
    quiet: bool = Field(False, json_schema_extra={"flag": "--quiet"}, description="Print no line every ten seconds.")
    log_level: str = Field("WARNING", description="DEBUG, INFO, WARNING or ERROR; to stderr.")

    @property
    def limits(self) -> Limits:
        """What clients are allowed."""
        return Limits(
            message_bytes=self.max_message_mb * MEGABYTE,
            memory_bytes=self.memory_mb * MEGABYTE,
            connections=self.max_connections,
            connect_timeout_s=self.connect_timeout_s,
            stall_timeout_s=self.stall_timeout_s,
            pressed_stall_timeout_s=self.pressed_stall_timeout_s,
            retained_bytes=self.max_retained_mb * MEGABYTE,
            subscriptions=self.max_subscriptions,
            name_length=self.max_name_length,
            offline_sessions=self.max_offline_sessions,
            session_expiry_s=self.session_expiry_s,
        )


def command(body: Callable[[Options], None]) -> Callable[..., None]:
    """`body` as a function with one parameter a field, for Typer to make options of."""

    def main(**given: Any) -> None:
        body(Options.model_validate(given))

    parameters = [_parameter(name, field) for name, field in Options.model_fields.items()]
    main.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    main.__annotations__ = {each.name: each.annotation for each in parameters}
    main.__doc__ = body.__doc__
    return main


def _parameter(name: str, field: FieldInfo) -> inspect.Parameter:
    given: dict[str, Any] = {"envvar": _PREFIX + name.upper(), "help": field.description}
    for bound in field.metadata:
        if isinstance(bound, annotated_types.Ge):
            given["min"] = bound.ge
        if isinstance(bound, annotated_types.Le):
            given["max"] = bound.le
    if isinstance(field.json_schema_extra, dict):
        given |= field.json_schema_extra
    names = [given.pop("flag")] if "flag" in given else []
    option: Any = typer.Option(*names, **given)
    annotation: Any = Annotated[field.annotation, option]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=annotation)
