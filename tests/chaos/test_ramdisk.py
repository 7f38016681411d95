"""A disk that is full, and has room again."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from jouleswarm.chaos import ramdisk
from jouleswarm.chaos.ramdisk import RamDisk, ram_disk


def test_a_full_disk_takes_nothing_and_is_copied_whole_in_the_end(tmp_path: Path) -> None:
    path = tmp_path / "run"
    with ram_disk(path) as disk:
        if disk is None:
            pytest.skip("no disk can be mounted here")
        (path / "before").write_bytes(bytes(10_000))
        disk.fill()
        with pytest.raises(OSError, match="No space left") as caught:
            (path / "during").write_bytes(bytes(100_000))
        assert caught.value.errno == errno.ENOSPC
        disk.make_room()
        (path / "after").write_bytes(bytes(100_000))
    assert (path / "before").read_bytes() == bytes(10_000)
    assert (path / "after").read_bytes() == bytes(100_000)
    assert [each.name for each in tmp_path.iterdir()] == ["run"]
    assert not path.is_mount()


def test_where_none_can_be_mounted_there_is_a_plain_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ramdisk, "_mount", lambda *_: False)
    with ram_disk(tmp_path / "run") as disk:
        assert disk is None
        (tmp_path / "run" / "rows").write_bytes(b"1")
    assert (tmp_path / "run" / "rows").read_bytes() == b"1"


def test_a_disk_that_grew_at_that_moment_is_made_full_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    answers, asked = iter([False, False, True]), []

    def mount(*arguments: str) -> bool:
        asked.append(arguments)
        return next(answers)

    monkeypatch.setattr(ramdisk, "_mount", mount)
    RamDisk(tmp_path).fill()
    assert len(asked) == 3
