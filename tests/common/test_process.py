"""What every process does alike."""

import os
import signal
import sys

import pytest

from jouleswarm.common import process


class Busy:
    """Output in the middle of a write: to flush it inside the handler of a signal is an error."""

    def flush(self) -> None:
        raise RuntimeError("reentrant call")


def test_a_signal_in_the_middle_of_a_write_ends_the_process_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    codes: list[int] = []
    monkeypatch.setattr(os, "_exit", codes.append)
    monkeypatch.setattr(sys, "stdout", Busy())
    monkeypatch.setattr(sys, "stderr", Busy())
    process._stop(signal.SIGTERM, None)
    process._stop(signal.SIGINT, None)
    assert codes == [143, 130]
