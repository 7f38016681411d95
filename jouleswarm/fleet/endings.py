"""How a process ended, in words that name the cause or say where to look for it."""

from __future__ import annotations

import signal
from pathlib import Path

from jouleswarm.common.disk.trouble import NO_SPACE, is_full

_FROM_OUTSIDE = "sent from outside"
_CAUSES = {
    signal.SIGKILL: f"{_FROM_OUTSIDE}, or by the kernel when memory is short: `dmesg` tells",
    signal.SIGBUS: "a file that it had mapped could not be read or written: is the disk full?",
    signal.SIGSEGV: "a fault in a compiled library",
    signal.SIGILL: "an instruction that this processor does not have",
    signal.SIGABRT: "a compiled library gave up",
}


def signal_of(code: int, *, is_broker: bool = False) -> signal.Signals | None:
    """The signal that an exit code tells of: -15 where it ended the process, 143 where the process took it and left.

    A broker ends in good order, with 0, and only when it is told to.
    """
    if is_broker and code == 0:
        return signal.SIGTERM
    number = -code if code < 0 else code - 128
    return signal.Signals(number) if number in signal.valid_signals() and number > 0 else None


def ending(name: str, code: int, log: Path, restarted: int = 0) -> str:
    """That `name` has ended, with its last words from its log, or the cause where it had none."""
    sent = signal_of(code, is_broker=name == "broker")
    told = f"{name} ended with code {code}" + ("" if sent is None else f" ({sent.name})")
    told += f", after it was started again {restarted} times" if restarted else ""
    words = _last_words(log, sent)
    if NO_SPACE not in words and is_full(log.parent):  # so that it could not say so
        words += f"; {NO_SPACE} on {log.parent}; make room, then go on from what is there"
    return f"{told}: {words}"


def _last_words(log: Path, sent: signal.Signals | None) -> str:
    try:
        lines = log.read_text(errors="replace").strip().splitlines()
    except FileNotFoundError:
        return f"its log {log} is gone; was the run directory moved or removed?"
    cause = "" if sent is None else _CAUSES.get(sent, _FROM_OUTSIDE)
    if not lines:
        return f"{cause or 'no cause told'}; it printed nothing to {log}"
    return f"{lines[-1]} (all of it: {log})" + (f"; {sent.name}: {cause}" if sent is not None else "")
