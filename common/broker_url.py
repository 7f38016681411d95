"""Broker URLs."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import unquote, urlsplit

from common.errors import ConfigurationError

DEFAULT_PORT = 1883


@dataclass(frozen=True)
class BrokerAddress:
    """A parsed broker URL."""

    host: str
    port: int
    user: str | None = None
    password: str | None = None

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"mqtt://{host}:{self.port}"  # never the password: this goes to logs and errors


def parse_url(url: str) -> BrokerAddress:
    """Parse mqtt://[user:password@]host[:port].

    Raises:
        ConfigurationError: not such a URL.
    """
    wanted = "expected mqtt://[user:password@]host[:1883]"
    try:
        parts = urlsplit(url)
        port = DEFAULT_PORT if parts.port is None else parts.port
    except ValueError as error:
        raise ConfigurationError(f"broker URL {_masked(url)!r}: {error}; {wanted}") from error
    host = parts.hostname or ""
    extra = parts.path.strip("/") or parts.query or parts.fragment
    if parts.scheme != "mqtt" or not host or port == 0 or extra or any(char.isspace() for char in url):
        raise ConfigurationError(f"broker URL {_masked(url)!r}: {wanted}")
    user = unquote(parts.username) if parts.username else None
    password = unquote(parts.password) if parts.password is not None else None
    return BrokerAddress(host, port, user, password)


def _masked(url: str) -> str:
    before, at, after = url.rpartition("@")
    return f"{before.split('://')[0]}://...@{after}" if at else url
