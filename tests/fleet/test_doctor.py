"""What `jouleswarm doctor` says, and what it never says."""

from __future__ import annotations

import getpass
import socket
from pathlib import Path

import pytest

from jouleswarm.fleet import doctor


def test_no_name_of_a_user_or_host_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "home", lambda: Path("/home/ada"))
    monkeypatch.setattr(getpass, "getuser", lambda: "ada")
    monkeypatch.setattr(socket, "gethostname", lambda: "engine")
    told = "/home/ada/.venv on engine, by ada; adapter of engines"
    assert doctor.anonymous(told) == "~/.venv on HOST, by USER; adapter of engines"


def test_a_port_that_somebody_has_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert doctor._port(port) == "in use: Address already in use"
    assert doctor._port(port) == "free"


def test_everything_that_a_bug_report_needs_is_there() -> None:
    found = doctor.findings()
    assert {"JouleSwarm", "Python", "packages", "processor", "cores", "memory", "disk here", "Docker", "joules"} <= (
        found.keys()
    )
    assert {"port 1883", "port 9883", "GPU's joules"} <= found.keys()
    assert all(found.values())
    assert doctor._asked("not installed", "no-such-program") == "not installed"
