"""A full disk."""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.disk.state import State
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.disk.trouble import allocate, disk_error, full_disk_is_told
from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.counters import Counters
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.learning.replay import Replay
from jouleswarm.runs.directory import RunDirectory
from tests.made_up import image

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_full_disk_is_named_with_what_is_needed(number: int) -> None:
    error = disk_error("a/frames.bin", OSError(number, "?"), 61_440_000)
    assert isinstance(error, RunError)
    assert str(error).startswith("no space left on a/frames.bin (61.4 MB needed)")


def test_another_error_of_the_disk_is_told_as_what_it_is() -> None:
    assert (
        str(disk_error("a", OSError(errno.EROFS, "Read-only file system"))) == "cannot write a: Read-only file system"
    )
    with pytest.raises(PermissionError), full_disk_is_told():
        raise PermissionError(errno.EACCES, "Permission denied", "a")


def test_a_full_disk_is_told_wherever_it_was_met() -> None:
    with pytest.raises(RunError, match=r"no space left on a/figure\.png"), full_disk_is_told():
        raise OSError(errno.ENOSPC, "No space left on device", "a/figure.png")
    with pytest.raises(RunError, match="no space left on run"), full_disk_is_told("run"):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_what_is_allocated_keeps_what_is_there_and_is_zeros_beyond(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "file"
    allocate(path, 3)
    assert path.read_bytes() == bytes(3)
    path.write_bytes(b"abc")
    allocate(path, 8)
    assert path.read_bytes() == b"abc" + bytes(5)
    allocate(path, 2)
    assert path.stat().st_size == 8


def test_a_file_system_that_cannot_allocate_is_written_zeros(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unable(descriptor: int, offset: int, size: int) -> None:
        raise OSError(errno.EOPNOTSUPP, "Operation not supported")

    monkeypatch.setattr(os, "posix_fallocate", unable)
    path = tmp_path / "file"
    path.write_bytes(b"abc")
    allocate(path, 3_000_000)
    assert path.read_bytes() == b"abc" + bytes(3_000_000 - 3)
    assert path.stat().st_blocks * 512 >= 3_000_000


@pytest.fixture
def small_disk() -> Iterator[None]:
    """No file can be larger than 4 kB."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))  # Python ignores SIGXFSZ
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def row(round_: int) -> RoundRow:
    return RoundRow(phase="fl", arm="fl", task=1, agent=1, round=round_, seconds=0.1)


def many_rows(folder: Path) -> None:
    directory = RunDirectory(folder)
    for round_ in range(1, 100):
        directory.round(row(round_))


def many_keys(folder: Path) -> None:
    (folder / "counters-0.bin").write_bytes(bytes(4096))
    Counters(folder).cell(("agent-1", "topic", "in"))


TOO_LARGE: dict[str, tuple[str, Callable[[Path], object]]] = {
    "frames": ("frames.bin", lambda folder: Replay(100, image(10, 10), folder / "frames.bin")),
    "counters": ("counters-0.bin", many_keys),
    "a state": ("s.0", lambda folder: StateFile(folder / "s", "o").save(State({"x": np.zeros(1000)}))),
    "a file replaced": ("model", lambda folder: write_whole(folder / "model", bytes(5000))),
    "a model": ("m.safetensors", lambda folder: RunDirectory(folder).weights("m", bytes(5000))),
    "rows": ("rounds.jsonl", many_rows),
    "progress": ("progress.jsonl", lambda folder: RunDirectory(folder).progress({"x": "y" * 5000})),
    "a summary": ("summary.json", lambda folder: RunDirectory(folder).summary({"x": "y" * 5000})),
}


@pytest.mark.usefixtures("small_disk")
@pytest.mark.parametrize("what", TOO_LARGE)
def test_a_full_disk_is_an_error_of_ours_that_names_the_file_whatever_is_written(what: str, tmp_path: Path) -> None:
    name, write = TOO_LARGE[what]
    with pytest.raises(RunError, match=rf"^no space left on {tmp_path}.*{name}"):
        write(tmp_path)
    assert list(tmp_path.rglob("*.part")) == []


def test_a_process_on_a_full_disk_ends_with_its_exit_code_though_it_cannot_say_so() -> None:
    script = (
        "import errno, sys\nfrom jouleswarm.common.process import process\nsys.stderr = open('/dev/full', 'w')\n"
        "with process('robot 1'):\n    raise OSError(errno.ENOSPC, 'No space left on device')\n"
    )
    assert subprocess.run([sys.executable, "-c", script], cwd=ROOT, check=False).returncode == 5
