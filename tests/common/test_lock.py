"""One owner of a folder."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from jouleswarm.common.disk import lock as module
from jouleswarm.common.disk.lock import Lock, await_free
from jouleswarm.common.errors import ConfigurationError

ROOT = Path(__file__).parents[2]


@contextmanager
def holder(folder: Path, then: str = "") -> Iterator[subprocess.Popen[str]]:
    """Another process that holds the folder, and tells when it does."""
    needed = "import sys; from pathlib import Path; from jouleswarm.common.disk.lock import Lock"
    script = f"{needed}; Lock(Path(sys.argv[1]), 'robot 7')"
    command = [sys.executable, "-c", f"{script}\n{then}\nprint(flush=True); sys.stdin.read()", str(folder)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, cwd=ROOT, text=True, **pipes) as process:  # type: ignore[call-overload]
        process.stdout.readline()
        yield process
        process.kill()


def test_a_second_owner_is_refused_with_the_first_ones_name(tmp_path: Path) -> None:
    with holder(tmp_path / "deep" / "state") as first:
        folder = tmp_path / "deep" / "state"
        named = (
            rf"^{folder} is held by robot 7, process {first.pid} on {socket.gethostname()}; end that, or name another$"
        )
        with pytest.raises(ConfigurationError, match=named):
            Lock(folder, "robot 8")


def test_a_process_that_was_killed_holds_nothing(tmp_path: Path) -> None:
    with holder(tmp_path) as first:
        first.kill()
        first.wait()
        Lock(tmp_path, "robot 8").release()


def test_a_program_that_was_started_by_the_holder_does_not_hold_the_folder(tmp_path: Path) -> None:
    child = "import subprocess; child = subprocess.Popen(['sleep', '60']); print(child.pid, flush=True)"
    with holder(tmp_path, child) as first:  # what it prints first is the child's id
        assert first.stdout is not None
        first.kill()
        first.wait()
        Lock(tmp_path, "robot 8").release()


def test_a_folder_that_was_let_go_of_is_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "mine").touch()
    with Lock(tmp_path, "robot 1"):
        with pytest.raises(ConfigurationError, match="held by robot 1"):
            Lock(tmp_path, "robot 2")
        assert sorted(path.name for path in tmp_path.iterdir()) == [".lock", "mine"]
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    with Lock(tmp_path, "robot 2"):
        pass


def test_a_lock_file_that_was_removed_and_made_anew_is_not_let_go_of_by_who_had_the_old_one(tmp_path: Path) -> None:
    old = Lock(tmp_path, "robot 1")
    (tmp_path / ".lock").unlink()
    with Lock(tmp_path, "robot 2"):
        old.release()
        with pytest.raises(ConfigurationError, match="held by robot 2"):
            Lock(tmp_path, "robot 3")


def test_a_folder_that_cannot_be_used_is_told_in_a_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match=f"^cannot use folder {tmp_path}/file: File exists; name another$"):
        Lock(tmp_path / "file", "robot 1")


def test_who_waits_for_a_folder_is_told_for_whom_and_goes_on_when_it_is_free(tmp_path: Path) -> None:
    told: list[str] = []
    with holder(tmp_path) as first:

        def tell(line: str) -> None:
            told.append(line)
            os.kill(first.pid, signal.SIGKILL)
            first.wait()

        await_free(tmp_path, 60, tell)
        assert told == [
            f"waiting for robot 7, process {first.pid} on {socket.gethostname()} to end, which holds {tmp_path}"
        ]
    await_free(tmp_path, 0, told.append)
    assert len(told) == 1


def test_who_waits_for_a_folder_does_not_wait_for_ever(tmp_path: Path) -> None:
    with Lock(tmp_path, "robot 1"), pytest.raises(ConfigurationError, match=r"held by robot 1.*; end that first"):
        await_free(tmp_path, 0, lambda line: None)


def test_without_locks_of_the_file_system_the_user_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def flock(descriptor: int, how: int) -> None:
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(module.fcntl, "flock", flock)
    Lock(tmp_path, "robot 1").release()
    assert "this file system has no locks" in caplog.text
