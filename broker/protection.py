"""From the broker's options to TLS files and a guard; a warning where both are missed."""

from __future__ import annotations

import ipaddress

from jouleswarm.broker.access import Guard
from jouleswarm.broker.options import Options
from jouleswarm.broker.tls import TlsFiles
from jouleswarm.common.bus import credentials as folder
from jouleswarm.common.errors import ConfigurationError


def protection_of(options: Options) -> tuple[TlsFiles | None, Guard | None]:
    """TLS files and guard, each None where the options do not ask for it. Single files come before a folder's.

    Raises:
        ConfigurationError: options that belong together are not all there, or a file cannot be read.
    """
    certificate, key, client_ca = options.tls_cert, options.tls_key, options.tls_client_ca
    users, rights, keys = options.users, options.rights, options.keys
    if keys is not None:
        folder.warn_of_exposed(keys)
        own = keys / folder.BROKER
        certificate, key = certificate or own / folder.SERVER, key or own / folder.SERVER_KEY
        client_ca = client_ca or own / folder.CA
        users, rights = users or own / folder.USERS, rights or own / folder.RIGHTS
    if (certificate is None) != (key is None) or (client_ca is not None and certificate is None):
        raise ConfigurationError("got a part of the TLS files; expected --tls-cert and --tls-key, with or without a CA")
    if (users is None) != (rights is None):
        raise ConfigurationError("got one of --users and --rights; expected both: without a right nothing is permitted")
    if keys is None:
        readable = [path for path in (key, users) if path is not None and folder.is_exposed(path)]
        folder.warn_of(readable, f"chmod go= {' '.join(map(str, readable))}")
    tls = TlsFiles(certificate, key, client_ca) if certificate is not None and key is not None else None
    guard = Guard(users, rights, options.connect_timeout_s) if users is not None and rights is not None else None
    return tls, guard


def warning_of(host: str, *, with_tls: bool, with_users: bool) -> str | None:
    """What to know before others can reach the broker; None where nobody can, or it is protected."""
    if _is_loopback(host) or (with_tls and with_users):
        return None
    if with_users:
        return f"warning: on {host} without TLS: passwords and messages go unencrypted; --keys FOLDER changes that"
    return (
        f"warning: on {host} without users: whoever reaches it may publish and read everything; make keys with "
        "`jouleswarm keys init`, then give --keys FOLDER"
    )


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
