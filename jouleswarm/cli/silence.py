"""Nobody looks at an empty screen: a command that has shown nothing for a while says what it is at."""

from __future__ import annotations

import sys
import threading

_AFTER_S = 0.4
_ERASE = "\r\x1b[2K"
_AT = {
    "run": "loading the scenario",
    "record": "loading the scenario",
    "validate": "trying the scenario's environment and network",
    "chaos": "loading the scenario",
    "report": "reading the run and pricing it",
    "compare": "reading the runs and pricing them",
    "export": "reading the run",
    "bill": "reading the counts and pricing them",
    "calibrate": "measuring batch gradients, for some seconds",
    "audit": "working the paper's figures out again",
    "study": "reading what there is already",
    "meter": "reading the rules",
    "keys": "making keys and certificates",
}


class Silence:
    """Says it once, on a terminal; the line is gone when there is something to show.

    Programs that read stderr find there what went wrong and nothing else.
    """

    def __init__(self, command: str, arguments: list[str]) -> None:
        """`arguments`: behind the command; those that ask for quiet are heard."""
        self._what = f"jouleswarm {command}: {_AT.get(command, 'at work')} ..."
        self._lock, self._is_over, self._is_shown = threading.Lock(), _is_alone(arguments), False
        self._timer = threading.Timer(_AFTER_S, self.say)
        self._timer.daemon = True
        self._timer.start()

    def end(self) -> None:
        """Something is shown, or the command is over."""
        if self._is_over:
            return
        with self._lock:
            self._timer.cancel()
            self._is_over = True
            if self._is_shown and sys.__stderr__ is not None:
                sys.__stderr__.write(_ERASE)
                sys.__stderr__.flush()

    def say(self) -> None:
        """Say it, unless it is over."""
        with self._lock:
            if self._is_over or self._is_shown or sys.__stderr__ is None:
                return
            self._is_shown = True
            sys.__stderr__.write(self._what)
            sys.__stderr__.flush()


def _is_alone(arguments: list[str]) -> bool:
    """Whether nobody looks, or wants to be told."""
    return "--quiet" in arguments or sys.__stderr__ is None or not sys.__stderr__.isatty()
