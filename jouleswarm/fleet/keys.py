"""Makes a folder of keys for a scenario (`common/bus/credentials.py` says what lies where)."""

from __future__ import annotations

import datetime
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

from argon2 import PasswordHasher

from jouleswarm.common.bus import credentials as folder
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.fleet.certificates import Certified, Validity, make_ca, make_client, make_server, serves
from jouleswarm.fleet.rights import rights_file, rights_of

# OWASP's least for argon2id: 19 MiB, two passes, one lane. Passwords of 256 random bits need no more.
_HASHER = PasswordHasher(time_cost=2, memory_cost=19 * 1024, parallelism=1)
_PRIVATE_FILE, _PRIVATE_FOLDER = 0o600, 0o700
_RENEWED = datetime.timedelta(days=7)  # before a certificate ends
_HOST = re.compile(r"[A-Za-z0-9._:-]+")


def make_keys(
    scenario: Scenario,
    out: Path,
    hosts: Sequence[str],
    days: int,
    now: datetime.datetime | None = None,
) -> list[str]:
    """Make the folder `out` and all that is in it, or nothing; returns the names of the clients.

    Certificates hold for `days` from `now` on.

    Raises:
        ConfigurationError: the folder is there already or cannot be made, or a host is none.
    """
    if wrong := [host for host in hosts if not _HOST.fullmatch(host)]:
        raise ConfigurationError(f"--hosts: got {wrong}; expected host names and addresses with commas between them")
    if out.exists():
        raise ConfigurationError(
            f"{out} is there already, and its keys may be in use; give another --out, or remove it first"
        )
    validity = Validity.days_from(now or datetime.datetime.now(datetime.UTC), days)
    out = out.absolute()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=".keys-", dir=out.parent))  # only its owner may enter it
        try:
            clients = _fill(work, scenario, hosts, validity)
            work.rename(out)
        except BaseException:
            shutil.rmtree(work, ignore_errors=True)
            raise
    except OSError as error:
        raise ConfigurationError(f"cannot make {out}: {error.strerror or error}; choose another --out") from error
    return clients


def refresh_keys(scenario: Scenario, out: Path, hosts: Sequence[str], days: int) -> list[str] | None:
    """Like `make_keys`, but leaves a folder that still serves (then None), and replaces one that does not.

    Raises:
        ConfigurationError: `out` is no folder of keys, or as for `make_keys`.
    """
    if not out.exists():
        return make_keys(scenario, out, hosts, days)
    certificate, rights = out / folder.BROKER / folder.SERVER, out / folder.BROKER / folder.RIGHTS
    if not (certificate.exists() and rights.exists()):
        raise ConfigurationError(f"{out} is there and is no folder of keys; nothing was removed: give another --out")
    if rights.read_text() == rights_file(rights_of(scenario)) and serves(certificate.read_bytes(), hosts, _RENEWED):
        return None
    shutil.rmtree(out)
    return make_keys(scenario, out, hosts, days)


def remove_keys(out: Path, clients: Sequence[str]) -> None:
    """Take clients out of a folder of keys: no broker that reads it lets them in, whatever they still hold.

    Topic rights stay, for they are the scenario's: the folder still serves it, as `refresh_keys` sees it.

    Raises:
        ConfigurationError: `out` is no folder of keys, one is no user of it, or it cannot be written to.
    """
    users = out / folder.BROKER / folder.USERS
    try:
        lines = users.read_text().splitlines(keepends=True)
        known = [line.partition(":")[0] for line in lines]
        if wrong := [client for client in clients if client not in known]:
            raise ConfigurationError(f"{out}: got {', '.join(wrong)}; expected some of {', '.join(known)}")
        left = [line for line, client in zip(lines, known, strict=True) if client not in clients]
        work = users.with_suffix(".new")
        work.unlink(missing_ok=True)
        _write(work, "".join(left).encode(), private=True)
        work.replace(users)  # a broker finds the old users or the new ones, never a part
        for client in clients:
            shutil.rmtree(out / client, ignore_errors=True)  # it may lie on the robot's machine alone
    except OSError as error:
        raise ConfigurationError(f"cannot use {users}: {error.strerror or error}; give the folder of keys") from error


def _fill(work: Path, scenario: Scenario, hosts: Sequence[str], validity: Validity) -> list[str]:
    ca = make_ca(f"JouleSwarm {scenario.name}", validity)
    server, clients = make_server(ca, hosts, validity), list(rights_of(scenario))
    passwords = {client: secrets.token_urlsafe(32) for client in clients}
    broker = work / folder.BROKER
    _certified(work, ca, folder.CA, folder.CA_KEY)
    _certified(broker, server, folder.SERVER, folder.SERVER_KEY)
    _write(broker / folder.CA, ca.certificate_pem)
    users = (f"{client}:{_HASHER.hash(password)}\n" for client, password in passwords.items())
    _write(broker / folder.USERS, "".join(users).encode(), private=True)
    _write(broker / folder.RIGHTS, rights_file(rights_of(scenario)).encode(), private=True)
    for client, password in passwords.items():
        own = work / client
        _certified(own, make_client(ca, client, validity), folder.CLIENT, folder.CLIENT_KEY)
        _write(own / folder.CA, ca.certificate_pem)
        _write(own / folder.PASSWORD, f"{password}\n".encode(), private=True)
    return clients


def _certified(where: Path, made: Certified, certificate: str, key: str) -> None:
    where.mkdir(mode=_PRIVATE_FOLDER, exist_ok=True)
    _write(where / certificate, made.certificate_pem)
    _write(where / key, made.key_pem, private=True)


def _write(path: Path, content: bytes, *, private: bool = False) -> None:
    mode = _PRIVATE_FILE if private else 0o644
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(content)
