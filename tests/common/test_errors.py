"""What the system says of a path that the user named becomes one of ours; nothing else does."""

import errno
from pathlib import Path

import pytest

from jouleswarm.common.errors import ConfigurationError, RunError, usable


def test_a_folder_below_a_file_is_told_with_what_it_is_for(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError) as error, usable("--out", tmp_path / "file" / "runs"):
        (tmp_path / "file" / "runs" / "a").mkdir(parents=True)
    assert str(error.value).startswith(f"--out {tmp_path}/file/runs: Not a directory ({tmp_path}/file/runs")


def test_a_file_within_is_named_and_the_kind_of_error_chosen(tmp_path: Path) -> None:
    with pytest.raises(RunError) as error, usable("run directory", tmp_path / "moved", RunError):
        (tmp_path / "moved" / "rounds.jsonl").open("a")
    told = f"run directory {tmp_path}/moved: No such file or directory ({tmp_path}/moved/rounds.jsonl)"
    assert str(error.value) == told


def test_files_elsewhere_and_what_is_no_file_stay_what_they_are(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), usable("--out", tmp_path / "runs"):
        (tmp_path / "another").read_text()
    with pytest.raises(ConnectionResetError), usable("--out", tmp_path):
        raise ConnectionResetError(errno.ECONNRESET, "reset")
    with pytest.raises(FileNotFoundError), usable("--state", None):
        (tmp_path / "another").read_text()
