"""The folder of keys (`jouleswarm keys init` makes one): where things lie in it, and what one client takes from it.

FOLDER/ca.crt                                    what every client trusts
FOLDER/ca.key                                    signs certificates; no process reads it
FOLDER/broker/{ca.crt,server.crt,server.key,users,rights}
FOLDER/NAME/{ca.crt,client.crt,client.key,password}     one folder a client: all that it needs
"""

from __future__ import annotations

import logging
import ssl
import stat
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from jouleswarm.common.errors import ConfigurationError

CA, CA_KEY = "ca.crt", "ca.key"
BROKER, SERVER, SERVER_KEY, USERS, RIGHTS = "broker", "server.crt", "server.key", "users", "rights"
CLIENT, CLIENT_KEY, PASSWORD = "client.crt", "client.key", "password"
_SECRETS = (CA_KEY, SERVER_KEY, USERS, CLIENT_KEY, PASSWORD)

log = logging.getLogger("jouleswarm.keys")


@dataclass(frozen=True)
class Credentials:
    """What one client shows to the broker, and whom it trusts. Without a CA file: whom the system trusts."""

    user: str | None = None
    password: str | None = field(default=None, repr=False)
    ca: Path | None = None
    certificate: Path | None = None
    key: Path | None = None

    def context(self) -> ssl.SSLContext:
        """TLS settings of this client.

        Raises:
            ConfigurationError: a file is missing or holds something else.
        """
        try:
            context = ssl.create_default_context(cafile=self.ca)
            if self.certificate is not None:
                context.load_cert_chain(self.certificate, self.key)
        except OSError as error:  # ssl.SSLError is one
            raise ConfigurationError(
                f"cannot use {self.ca}, {self.certificate} and {self.key} for TLS: {error.strerror or error}; "
                "expected PEM files as `jouleswarm keys init` makes them"
            ) from error
        return context


def exposed(folder: Path) -> list[Path]:
    """The secrets in a folder of keys, as far as this process sees them, that others than their owner can read."""
    secrets = sorted(path for name in _SECRETS for path in (*folder.glob(name), *folder.glob(f"*/{name}")))
    return [path for path in secrets if is_exposed(path)]


@cache
def warn_of_exposed(folder: Path) -> None:
    """Say in one line, once a process, that others can read keys."""
    warn_of(exposed(folder), f"chmod -R go= {folder}")


def warn_of(readable: Sequence[Path], remedy: str) -> None:
    """Say in one line that others can read these files."""
    if readable:
        more = f" and {len(readable) - 1} more" if len(readable) > 1 else ""
        log.warning("warning: others than the owner can read %s%s; %s keeps them out", readable[0], more, remedy)


def is_exposed(path: Path) -> bool:
    """Whether others than its owner can read a file, its folder let them in."""
    try:
        file, held = path.stat().st_mode, path.parent.stat().st_mode
    except OSError:  # not for this process to see
        return False
    group = file & stat.S_IRGRP and held & stat.S_IXGRP
    return bool(group or (file & stat.S_IROTH and held & stat.S_IXOTH))


def credentials_of(folder: Path | None, client: str) -> Credentials | None:
    """What the client called `client` takes from a folder of keys; None without a folder.

    Raises:
        ConfigurationError: there is nothing for this client.
    """
    if folder is None:
        return None
    warn_of_exposed(folder)
    own = folder / client
    try:
        password = (own / PASSWORD).read_text().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            f"--keys {folder}: cannot read {own / PASSWORD} ({getattr(error, 'strerror', None) or error}); expected a "
            f"folder with one called {client}: `jouleswarm keys init SCENARIO --out {folder}` makes one for each "
            "client of a scenario"
        ) from error
    return Credentials(client, password, own / CA, own / CLIENT, own / CLIENT_KEY)
