"""Who may connect to the broker, and what each client may publish and read."""

from __future__ import annotations

import asyncio
import hmac
import secrets
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from argon2 import PasswordHasher, Type, extract_parameters
from argon2.exceptions import Argon2Error, InvalidHashError

from jouleswarm.broker.attempts import Attempts
from jouleswarm.broker.rights import Access, Rights, Rule, parse_rights, permits, permits_filter
from jouleswarm.common.bus.paho_client import name_of
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire import topics

# Return codes of CONNACK (MQTT 3.1.1, section 3.2.2.3).
UNAVAILABLE, BAD_CREDENTIALS, NOT_AUTHORIZED = 3, 4, 5
VERIFICATIONS = 2  # at once: each takes a core for tens of milliseconds, and tens of megabytes
CACHED_TOPICS = 1000
Users = dict[str, str]


class Refused(Exception):
    """A client that is not let in; `code` is what its CONNACK says, the text is for the broker's log."""

    def __init__(self, code: int, text: str, event: str = "refused_not_authorized") -> None:
        super().__init__(text)
        self.code, self.event = code, event


class Book(NamedTuple):
    """Users and rights as they were read last."""

    users: Users
    rights: Rights


class Grants:
    """One client's rights, always by the newest book. What was decided for a topic is kept, up to a limit.

    Who is no user any more keeps the rights it had: for its last will, by which others learn that it is gone.
    """

    def __init__(self, guard: Guard, user: str, client_id: str, shown: str, refused: Callable[[str], None]) -> None:
        """`shown`: the hash of the password that it has shown."""
        self._guard, self._user, self._client_id, self._shown = guard, user, client_id, shown
        self._refused, self._publish = refused, dict[str, bool]()
        self._book = guard.book
        self._groups = self._book.rights.of(user, client_id)

    @property
    def hold(self) -> bool:
        """Whether its user is still one, by the same password."""
        return self._guard.book.users.get(self._user) == self._shown

    @property
    def _rules(self) -> tuple[tuple[Rule, ...], ...]:
        if self._book is not self._guard.book and self.hold:
            self._book = self._guard.book
            self._groups = self._book.rights.of(self._user, self._client_id)
            self._publish.clear()
        return self._groups

    def may_publish(self, topic: str) -> bool:
        """Whether the client may publish on `topic`; the first refusal of a topic is told."""
        rules = self._rules
        allowed = self._publish.get(topic)
        if allowed is None:
            allowed = permits(rules, Access.WRITE, topic)
            if len(self._publish) >= CACHED_TOPICS:
                self._publish.clear()
            self._publish[topic] = allowed
            if not allowed:
                self._refused(f"publish on {topic}")
        return allowed

    def may_receive(self, topic: str) -> bool:
        """Whether messages on `topic` may be delivered to the client."""
        return topic == topics.BROKER_LIMITS or permits(self._rules, Access.READ, topic)

    def may_subscribe(self, topic_filter: str) -> bool:
        """Whether one of its rights covers the filter; what the broker takes everybody may know."""
        if allowed := topic_filter == topics.BROKER_LIMITS or permits_filter(self._rules, topic_filter):
            return True
        self._refused(f"subscribe to {topic_filter}")
        return allowed


class Guard:
    """Checks logins against users and passwords, in threads: a login never keeps the event loop from traffic.

    Who has shown a password once is let in by it at once from then on: many that come back together, or that try again
    because an overloaded machine was too slow for them, do not have to be verified over and over.
    """

    def __init__(self, users: Path, rights: Path, timeout_s: float) -> None:
        """Raises ConfigurationError where a file cannot be read, or a line of it is not as it should be."""
        self._users, self._rights, self._timeout_s = users, rights, timeout_s
        self.book = self._read()
        self._hasher = PasswordHasher(time_cost=2, memory_cost=19 * 1024, parallelism=1)
        # Verified for a user that does not exist, so that the time does not tell.
        self._nobody = self._hasher.hash("")
        self._turns = asyncio.Semaphore(VERIFICATIONS)
        self._threads = ThreadPoolExecutor(VERIFICATIONS, "login")
        self._key, self._verified = secrets.token_bytes(32), dict[str, bytes]()
        self._attempts = Attempts()

    def read_anew(self) -> str:
        """Go by both files as they are now; gives that in words.

        Raises:
            ConfigurationError: as at the beginning; the book before stays.
        """
        self.book = self._read()
        known = set(self.book.users.values())
        self._verified = {encoded: digest for encoded, digest in self._verified.items() if encoded in known}
        return f"{len(self.book.users)} users of {self._users} and the rights of {self._rights}"

    async def admit(self, session: Any, source: str, refused: Callable[[str], None]) -> Grants:
        """The rights of a client that may connect; `source` is the address that it comes from.

        Raises:
            Refused: wrong user or password, or a client id, certificate or last will that is not the user's own.
        """
        user, client_id = session.username or "", session.client_id
        shown = await self._shown(user, session.password or b"", source)
        if name_of(client_id) != user:
            raise Refused(NOT_AUTHORIZED, f"user {user!r} with the client id {client_id!r}; expected its own name")
        certified = common_name(session.ssl_object)
        if certified not in (None, user):
            raise Refused(NOT_AUTHORIZED, f"user {user!r} with the certificate of {certified!r}; expected its own")
        grants = Grants(self, user, client_id, shown, refused)
        if session.will is not None and not grants.may_publish(session.will.topic):
            raise Refused(NOT_AUTHORIZED, f"user {user!r} with a last will on {session.will.topic!r}")
        return grants

    def close(self) -> None:
        """No more logins."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    def _read(self) -> Book:
        return Book(
            parse_users(_read(self._users), str(self._users)), parse_rights(_read(self._rights), str(self._rights))
        )

    async def _shown(self, user: str, password: bytes, source: str) -> str:
        """The hash of the password that the user has just shown. Raises Refused."""
        encoded, digest = self.book.users.get(user), self._digest(password)
        if encoded is not None and hmac.compare_digest(self._verified.get(encoded, b""), digest):
            return encoded
        try:
            async with asyncio.timeout(self._timeout_s), self._turns:
                if self._attempts.must_wait(source, time.monotonic()):
                    told = f"too many logins from {source} have failed: none is looked at for a while"
                    raise Refused(UNAVAILABLE, told, "refused_too_often")
                loop = asyncio.get_running_loop()
                is_right = await loop.run_in_executor(self._threads, self._verify, encoded or self._nobody, password)
                if encoded is not None and is_right:
                    self._verified[encoded] = digest
                    return encoded
                self._attempts.failed(source, time.monotonic())
        except TimeoutError:
            raise Refused(UNAVAILABLE, f"too many logins to verify within {self._timeout_s:g} s") from None
        raise Refused(BAD_CREDENTIALS, f"user {user!r}: no such user, or not its password")

    def _verify(self, encoded: str, password: bytes) -> bool:
        try:
            return self._hasher.verify(encoded, password)
        except Argon2Error:
            return False

    def _digest(self, password: bytes) -> bytes:
        # By a key that only this process has: of no use to who reads it elsewhere.
        return hmac.digest(self._key, password, "sha256")


def common_name(tls: Any) -> str | None:
    """Common name of the certificate that a client has shown; None without one."""
    subject = (tls.getpeercert() or {}).get("subject", ()) if tls is not None else ()
    return next((value for part in subject for name, value in part if name == "commonName"), None)


def parse_users(text: str, source: str = "users") -> Users:
    """Lines of NAME:HASH, as in Mosquitto's password_file; HASH is argon2id, as RFC 9106's reference encodes it.

    Raises:
        ConfigurationError: a line is not like that.
    """
    users: Users = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        name, _, encoded = line.strip().partition(":")
        try:
            usable = bool(name) and name not in users and extract_parameters(encoded).type is Type.ID
        except InvalidHashError:
            usable = False
        if not usable:
            raise ConfigurationError(  # not the line itself: it could hold a password
                f"{source}, line {number}, user {name!r}: expected NAME:$argon2id$..., each name once; "
                "`jouleswarm keys init` makes such a file"
            )
        users[name] = encoded
    return users


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise ConfigurationError(f"cannot read {path}: {why}; `jouleswarm keys init` makes one") from error
