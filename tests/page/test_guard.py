"""Who may see the page."""

import asyncio
from typing import Any

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.page import serve
from jouleswarm.page.guard import guard, may

HERE = {"host": "127.0.0.1:8050"}
THERE = {"host": "lab.example:8050"}


@pytest.mark.parametrize(
    ("headers", "asked", "token", "answered"),
    [
        (HERE, None, None, True),
        ({"host": "localhost:8050"}, None, None, True),
        ({"host": "[::1]:8050"}, None, None, True),
        (THERE, None, None, False),  # a name that somebody has made to point here
        ({**HERE, "origin": "http://127.0.0.1:8050"}, None, None, True),
        ({**HERE, "origin": "https://evil.example"}, None, None, False),
        (THERE, None, "secret", False),
        (THERE, "wrong", "secret", False),
        (THERE, "secret", "secret", True),
        ({**THERE, "cookie": "other=1; jouleswarm_page=secret"}, None, "secret", True),
        ({**THERE, "cookie": "jouleswarm_page=secret"}, "wrong", "secret", False),
        ({**THERE, "cookie": "jouleswarm_page=secret", "origin": "https://evil.example"}, None, "secret", False),
        (THERE, "gehëim", "secret", False),
    ],
)
def test_who_may(headers: dict[str, str], asked: str | None, token: str | None, answered: bool) -> None:
    assert may(headers, asked, token) is answered


def ask(kind: str, query: str = "", cookie: str = "") -> list[dict[str, Any]]:
    """What a guarded page answers elsewhere."""
    sent: list[dict[str, Any]] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        return {}

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    headers = [(b"host", b"lab.example"), (b"cookie", cookie.encode())]
    scope = {"type": kind, "headers": headers, "query_string": query.encode()}
    asyncio.run(guard(app, "secret")(scope, receive, send))
    return sent


def test_the_token_becomes_a_cookie_and_without_there_is_nothing() -> None:
    (shown,) = ask("http", "token=secret")
    assert shown["headers"] == [(b"set-cookie", b"jouleswarm_page=secret; Path=/; HttpOnly; SameSite=Strict")]
    assert ask("http", cookie="jouleswarm_page=secret")[0]["headers"] == []
    assert ask("http")[0]["status"] == 403
    assert ask("websocket") == [{"type": "websocket.close", "code": 1008}]


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.5", "localhost", "::1"])
def test_on_this_machine_there_is_no_token(host: str) -> None:
    assert serve.new_token(host) is None


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.7", "::", "lab.example"])
def test_elsewhere_there_is_one(host: str) -> None:
    token = serve.new_token(host)
    assert token is not None
    assert len(token) >= 32
    assert serve.new_token(host) != token


def test_a_port_that_is_taken_is_told_and_by_default_the_next_one_is_found() -> None:
    with serve.listening("127.0.0.1", 0) as sock:
        port = sock.getsockname()[1]
        with pytest.raises(ConfigurationError, match=f"cannot listen on 127.0.0.1, port {port}"):
            serve.listening("127.0.0.1", port)


def test_a_missing_nicegui_is_one_line_that_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ConfigurationError, match=r"pip install jouleswarm\[page\]") as told:
        serve.check_installed()
    assert told.value.exit_code == 2
