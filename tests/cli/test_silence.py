"""A command that has nothing to show yet says what it is at."""

import io
import sys

import pytest

from jouleswarm.cli.silence import Silence


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_what_a_command_is_at_is_told_once_on_a_terminal_and_erased_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "__stderr__", stream := Terminal())
    silence = Silence("audit", [])
    silence.say()
    silence.say()
    silence.end()
    silence.say()
    assert stream.getvalue() == "jouleswarm audit: working the paper's figures out again ...\r\x1b[2K"


def test_nothing_is_told_once_there_is_something_to_show_or_where_quiet_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "__stderr__", terminal := Terminal())
    shown, quiet = Silence("audit", []), Silence("keys", ["init", "--quiet"])
    shown.end()
    monkeypatch.setattr(sys, "__stderr__", pipe := io.StringIO())
    piped = Silence("audit", [])
    for each in (shown, quiet, piped):
        each.say()
        each.end()
    assert terminal.getvalue() + pipe.getvalue() == ""
