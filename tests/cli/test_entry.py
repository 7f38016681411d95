"""What stands around every command: signals, output that goes away, errors as one line."""

import errno
import os
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from jouleswarm.cli import entry
from jouleswarm.cli.entry import command_line
from jouleswarm.common.invoked import executable
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.fleet.stopping import telling_what_is_kept
from jouleswarm.runs.directory import RunDirectory


@pytest.fixture(autouse=True)
def _signals() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def ended_by(body: Callable[[], None]) -> object:
    with pytest.raises(SystemExit) as ended, command_line():
        body()
    return ended.value.code


def raise_(error: BaseException) -> None:
    raise error


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_service_manager_and_a_closed_terminal_stop_a_command_as_ctrl_c_does(
    number: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended_by(lambda: os.kill(os.getpid(), number)) == 130
    assert capsys.readouterr().err == "stopped\n"


def test_under_nohup_a_closed_terminal_stops_nothing() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with command_line():
        os.kill(os.getpid(), signal.SIGHUP)


def test_files_that_are_used_up_are_one_line_and_a_defect_is_not(capsys: pytest.CaptureFixture[str]) -> None:
    assert ended_by(lambda: raise_(OSError(errno.EMFILE, "Too many open files", "some.so"))) == 5
    assert "Too many open files (some.so); raise `ulimit -n`" in capsys.readouterr().err
    with pytest.raises(FileNotFoundError), command_line():
        raise FileNotFoundError(errno.ENOENT, "No such file or directory", "a defect of ours")


def run_directory(path: Path, *, state: bool, rows: int) -> RunDirectory:
    directory = RunDirectory(path)
    directory.manifest({})
    for round_ in range(1, rows + 1):
        directory.round(RoundRow(phase="fl", arm="fl", task=1, agent=1, round=round_, seconds=0.1))
    if state:
        (path / "state").mkdir()
    return directory


def test_ctrl_c_says_through_typer_what_is_kept_and_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_directory(tmp_path / "a run", state=True, rows=3)
    app = typer.Typer(add_completion=False)

    @app.command()
    def run() -> None:
        with telling_what_is_kept(tmp_path / "a run"):
            raise KeyboardInterrupt

    monkeypatch.setattr(sys, "argv", ["jouleswarm"])
    assert ended_by(app) == 130
    go_on = f"`{executable()} run --resume '{tmp_path}/a run'` goes on from there"
    assert capsys.readouterr().err == f"stopped: 3 rows are kept in {tmp_path}/a run; {go_on}\n"


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (
            lambda path: run_directory(path, state=False, rows=2),
            f"2 rows are kept in {{0}}; `{executable()} report {{0}}`",
        ),
        (RunDirectory, "nothing had begun; {0} can be deleted"),
    ],
)
def test_what_cannot_be_gone_on_with_is_told_as_that(make: Any, told: str, tmp_path: Path) -> None:
    make(tmp_path / "run")
    with pytest.raises(KeyboardInterrupt) as stop, telling_what_is_kept(tmp_path / "run"):
        raise KeyboardInterrupt
    assert told.format(tmp_path / "run") in str(stop.value)


def test_output_that_nobody_reads_is_lost_and_ends_nothing() -> None:
    reading, writing = os.pipe()
    outlet = entry._Lasting(writing, lambda: None)
    os.close(reading)
    assert outlet.write(b"lost") == 4
    assert outlet.write(b"also") == 4
    outlet.close()


def test_letters_that_a_terminal_does_not_have_are_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (tmp_path / "latin").open("w", encoding="latin-1") as terminal:
        monkeypatch.setattr(sys, "__stdout__", terminal)
        entry._lasting(terminal, lambda: None).write("joules ≥ 3 é\n")
    assert (tmp_path / "latin").read_text(encoding="latin-1") == "joules ? 3 é\n"
