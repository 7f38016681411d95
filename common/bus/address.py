"""Broker URLs."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import unquote, urlsplit

from jouleswarm.common.errors import ConfigurationError

DEFAULT_PORT, DEFAULT_TLS_PORT = 1883, 8883  # as registered with IANA


@dataclass(frozen=True)
class BrokerAddress:
    """A parsed broker URL."""

    host: str
    port: int
    user: str | None = None
    password: str | None = None
    tls: bool = False

    def __str__(self) -> str:
        # Neither user nor password: this goes to logs, errors and manifests.
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'mqtts' if self.tls else 'mqtt'}://{host}:{self.port}"


def parse_url(url: str) -> BrokerAddress:
    """Parse mqtt://[user:password@]host[:port], or mqtts:// for TLS.

    Raises:
        ConfigurationError: not such a URL.
    """
    wanted = "expected mqtt://[user:password@]host[:1883], or mqtts://[user:password@]host[:8883] for TLS"
    try:
        parts = urlsplit(url)
        tls = parts.scheme == "mqtts"
        port = (DEFAULT_TLS_PORT if tls else DEFAULT_PORT) if parts.port is None else parts.port
    except ValueError as error:
        raise ConfigurationError(f"broker URL {_masked(url)!r}: {error}; {wanted}") from error
    host = parts.hostname or ""
    extra = parts.path.strip("/") or parts.query or parts.fragment
    if parts.scheme not in ("mqtt", "mqtts") or not host or port == 0 or extra or any(char.isspace() for char in url):
        raise ConfigurationError(f"broker URL {_masked(url)!r}: {wanted}")
    user = unquote(parts.username) if parts.username else None
    password = unquote(parts.password) if parts.password is not None else None
    return BrokerAddress(host, port, user, password, tls)


def _masked(url: str) -> str:
    before, at, after = url.rpartition("@")
    return f"{before.split('://')[0]}://...@{after}" if at else url
