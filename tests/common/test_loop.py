"""The meter for anybody's training loop: what it writes, worked out by hand."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jouleswarm import Meter
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter import loop
from jouleswarm.common.meter.power import Rated

MEASURED = ("seconds", "cpu_s", "joules")


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def counts(path: Path, *columns: str) -> dict[tuple[str, ...], float]:
    """Sums of what is not measured, by `what` and more columns."""
    sums: dict[tuple[str, ...], float] = defaultdict(float)
    for row in rows(path):
        if row["what"] not in MEASURED:
            sums[tuple(row[column] for column in ("what", *columns))] += float(row["value"])
    return dict(sums)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "counts.csv"


def test_a_robot_counts_by_phase_and_round(file: Path) -> None:
    meter = Meter("client-3", file=file, arm="FedAvg", task=2)
    for number in (7, 8):
        with meter.phase("train", round=number):
            meter.gradients(20)
        meter.sent("uplink", 1000)
        meter.received("downlink", 3000)
    meter.flush()
    assert counts(file, "activity", "round") == {
        ("gradients", "train", "7"): 20,
        ("gradients", "train", "8"): 20,
        ("uplink_bytes", "", ""): 2000,
        ("uplink_messages", "", ""): 2,
        ("downlink_bytes", "", ""): 6000,
        ("downlink_messages", "", ""): 2,
    }
    assert {(row["arm"], row["phase"], row["task"], row["robot"]) for row in rows(file)} == {
        ("FedAvg", "fl", "2", "client-3")
    }


def test_a_server_tells_whose_link_it_is_and_computes_for_itself(file: Path) -> None:
    meter = Meter("server", "server", file, stage="ml")
    meter.received("uplink", 1000, sender="client-3")
    meter.sent("downlink", 500, to="client-4")
    meter.gradients(3)
    meter.flush()
    assert counts(file, "phase", "robot", "end") == {
        ("uplink_bytes", "ml", "client-3", "received"): 1000,
        ("uplink_messages", "ml", "client-3", "received"): 1,
        ("downlink_bytes", "ml", "client-4", "sent"): 500,
        ("downlink_messages", "ml", "client-4", "sent"): 1,
        ("gradients", "ml", "datacenter", ""): 3,
    }


def test_neighbours_are_the_ends_of_a_sidelink_whoever_counts(file: Path) -> None:
    one, other = Meter("a-1", file=file), Meter("a-2", file=file)
    one.sent("sidelink", 10, to="a-2")
    other.received("sidelink", 10, sender="a-1")
    one.flush()
    other.flush()
    ends = counts(file, "robot", "to", "end")
    assert ends["sidelink_bytes", "a-1", "a-2", "sent"] == ends["sidelink_bytes", "a-1", "a-2", "received"] == 10


def test_a_phase_has_its_own_seconds_and_joules_and_one_inside_is_no_part_of_it(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wall, cpu = iter(range(0, 10**12, 10**9)), iter(range(0, 10**12, 10**8))  # a second and 0.1 s at each look
    real = loop.JouleMeter
    clocks = (lambda: next(wall), lambda: next(cpu))
    monkeypatch.setattr(loop, "JouleMeter", lambda *given: real(*given, clocks=clocks))
    monkeypatch.setattr("jouleswarm.common.meter.power.Rapl.__init__", _missing)
    meter = Meter("client-1", file=file, rated=Rated(tdp_w=40, cores=4))  # 10 W a core
    with meter.phase("round", round=1), meter.phase("train", round=1):  # begin at 1 s and 2 s
        pass  # end at 3 s and 4 s
    meter.flush()
    told = {(row["what"], row["activity"]): float(row["value"]) for row in rows(file) if row["round"]}
    assert told == {
        ("seconds", "round"): 2, ("cpu_s", "round"): 0.2, ("joules", "round"): 2,
        ("seconds", "train"): 1, ("cpu_s", "train"): 0.1, ("joules", "train"): 1,
    }  # fmt: skip
    assert {row["how"] for row in rows(file) if row["what"] == "joules"} == {"estimated: CPU time x 10 W"}


def test_a_gpu_s_joules_are_rows_of_their_own_and_its_seconds_are_not_told_twice(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Gpu:
        how = "nvml"

        def joules(self) -> float:
            return 5.0

    monkeypatch.setattr(loop, "gpu", lambda uuid: Gpu() if uuid == "a-uuid" else None)
    monkeypatch.setattr("jouleswarm.common.meter.power.Rapl.__init__", _missing)
    meter = Meter("client-1", file=file, gpu_uuid="a-uuid")
    meter.flush()
    assert sorted((row["what"], row["how"]) for row in rows(file)) == [
        ("cpu_s", ""), ("joules", f"estimated: CPU time x {85 / (os.cpu_count() or 1):.4g} W"), ("joules", "nvml"),
        ("seconds", ""),
    ]  # fmt: skip
    assert [float(row["value"]) for row in rows(file) if row["how"] == "nvml"] == [pytest.approx(5)]


def _missing(*_: object) -> None:
    raise FileNotFoundError


def test_callbacks_of_other_threads_count_every_message(file: Path) -> None:
    meter = Meter("client-1", file=file)

    def callback() -> None:
        for _ in range(5000):
            meter.received("downlink", 2)

    threads = [threading.Thread(target=callback) for _ in range(4)]
    with meter.phase("train"):
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        with pytest.raises(ConfigurationError, match="phase eat in a second thread"):
            raise _raised_in_a_thread(lambda: meter.phase("eat").__enter__())
    meter.flush()
    assert counts(file, "activity") == {("downlink_bytes", "train"): 40_000, ("downlink_messages", "train"): 20_000}


def _raised_in_a_thread(body: Callable[[], object]) -> BaseException:
    raised: list[BaseException] = []

    def run() -> None:
        try:
            body()
        except ConfigurationError as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return raised[0]


def run(file: Path, *lines: str) -> subprocess.CompletedProcess[str]:
    head = ["import os, signal, sys", "from jouleswarm import Meter", f"m = Meter('client-1', file={str(file)!r})"]
    return subprocess.run([sys.executable, "-c", "\n".join([*head, *lines])], text=True, capture_output=True)


def test_what_was_counted_is_written_at_exit_and_no_library_is_loaded(file: Path) -> None:
    done = run(file, "m.gradients(5)", "print({'torch', 'numpy', 'pydantic'} & set(sys.modules))")
    assert (done.returncode, done.stdout) == (0, "set()\n"), done.stderr
    assert counts(file) == {("gradients",): 5}


def test_a_killed_process_leaves_what_was_flushed_and_the_next_goes_on(file: Path) -> None:
    done = run(file, "m.gradients(5)", "m.flush()", "m.gradients(6)", "os.kill(os.getpid(), signal.SIGKILL)")
    assert done.returncode == -signal.SIGKILL
    assert counts(file) == {("gradients",): 5}
    run(file, "m.gradients(7)")
    assert counts(file) == {("gradients",): 12}


def test_a_forked_child_does_not_tell_again_what_its_parent_tells(file: Path) -> None:
    done = run(file, "m.gradients(5)", "pid = os.fork()", "m.gradients(1)", "os.waitpid(pid, 0) if pid else None")
    assert done.returncode == 0, done.stderr
    assert counts(file) == {("gradients",): 7}


def test_a_child_forked_inside_a_phase_goes_on_counting(file: Path) -> None:
    child = ("os.fork() and os.wait()", "m.gradients(1)")
    done = run(file, "with m.phase('a'):", *(f"    {line}" for line in child), "with m.phase('b'): m.gradients(1)")
    assert done.returncode == 0, done.stderr
    assert counts(file, "activity") == {("gradients", "a"): 1, ("gradients", "b"): 2, ("gradients", ""): 1}


def test_several_processes_share_a_file(file: Path) -> None:
    code = f"from jouleswarm import Meter; Meter('c-1', file={str(file)!r}).gradients(3)"
    started = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(3)]
    assert [process.wait(60) for process in started] == [0, 0, 0]
    assert counts(file) == {("gradients",): 9}
    assert file.read_text().count("arm,phase") == 1


def test_a_full_disk_leaves_no_half_row_and_the_counts(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    meter = Meter("client-1", file=file)
    meter.gradients(5)
    before = file.read_bytes()
    monkeypatch.setattr(loop.Path, "open", lambda path, *_, **__: _Full(path))
    with pytest.raises(OSError, match="No space left"):
        meter.flush()
    monkeypatch.undo()
    assert file.read_bytes() == before
    meter.flush()
    assert counts(file) == {("gradients",): 5}


class _Full:
    """A file on a disk with room for ten bytes more."""

    def __init__(self, path: Path) -> None:
        self._file = open(path, "a+b", buffering=0)  # noqa: SIM115

    def __enter__(self) -> _Full:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def write(self, data: bytes) -> int:
        return self._file.write(data[:10])


@pytest.mark.parametrize(
    ("use", "said"),
    [
        (lambda file: Meter("", file=file), "meter: name '', expected 1 to 100 printable letters"),
        (lambda file: Meter("a\nb", file=file), r"meter: name 'a\nb'"),
        (lambda file: Meter("server", file=file), "meter server: a robot's name, expected another one"),
        (lambda file: Meter("a", "cook", file), "role 'cook', expected 'robot' or 'server'"),
        (lambda file: Meter("a", file=file.parent / "none" / "c.csv"), "(No such file or directory)"),
        (lambda file: Meter("a", file=Path(__file__)), "is not a meter's file, expected a new one"),
        (
            lambda file: Meter("a", file=file).sent("downlink", 1),
            "has sent downlink, expected uplink or sidelink",
        ),
        (lambda file: Meter("a", file=file).sent("up", 1), "a robot has sent up, expected uplink or sidelink"),
        (lambda file: Meter("a", file=file).sent("sidelink", 1), "sent sidelink without to=, expected a client's name"),
        (lambda file: Meter("s", "server", file).received("uplink", 1), "received uplink without sender="),
        (lambda file: Meter("a", file=file).sent("sidelink", 1, to="b\n"), r"meter: name 'b\n', expected"),
        (lambda file: Meter("a", file=file).sent("uplink", -1), "-1 of uplink, expected 0 or more"),
        (lambda file: Meter("a", file=file).phase("").__enter__(), "meter: name ''"),
    ],
)
def test_what_can_not_be_is_one_line(file: Path, use: Callable[[Path], object], said: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        use(file)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
