"""Who may see the page: this machine's users, elsewhere who has the token."""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from http.cookies import SimpleCookie
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

_COOKIE = "jouleswarm_page"
_LOCAL = ("localhost", "127.0.0.1", "::1")


def guard(app: ASGIApp, token: str | None) -> ASGIApp:
    """`app` for who may: with a token who has shown it; without, who asks for this machine by its own names.

    No page of another origin may speak to it either: browsers let any open a web socket.
    """

    async def guarded(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        asked = _asked_token(scope)
        if not may(headers, asked, token):
            await _refuse(scope, send)
        elif token is not None and asked is not None and scope["type"] == "http":
            await app(scope, receive, _with_cookie(send, token))
        else:
            await app(scope, receive, send)

    return guarded


def may(headers: Mapping[str, str], asked: str | None, token: str | None) -> bool:
    """Whether a request is answered; `asked`: the token in its address."""
    host, origin = headers.get("host", ""), headers.get("origin")
    if origin is not None and urlsplit(origin).netloc != host:
        return False
    if token is None:
        return urlsplit(f"//{host}").hostname in _LOCAL
    cookies = SimpleCookie(headers.get("cookie", ""))
    shown = asked if asked is not None else cookies[_COOKIE].value if _COOKIE in cookies else ""
    return hmac.compare_digest(shown.encode(), token.encode())


def _asked_token(scope: Scope) -> str | None:
    found = parse_qs(scope["query_string"].decode("latin-1")).get("token")
    return found[0] if found else None


def _with_cookie(send: Send, token: str) -> Send:
    cookie = f"{_COOKIE}={token}; Path=/; HttpOnly; SameSite=Strict".encode()

    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), (b"set-cookie", cookie)]}
        await send(message)

    return sent


async def _refuse(scope: Scope, send: Send) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    told = b"This page wants the token that `jouleswarm` printed with its address.\n"
    await send({"type": "http.response.start", "status": 403, "headers": [(b"content-type", b"text/plain")]})
    await send({"type": "http.response.body", "body": told})
