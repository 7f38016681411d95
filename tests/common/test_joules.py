"""Joules that a process measures of itself: hand-worked, with made-up clocks and counters."""

from __future__ import annotations

import logging
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from jouleswarm.common.meter.joule_meter import JouleMeter
from jouleswarm.common.meter.meter import Meter, read_joules
from jouleswarm.common.meter.power import Estimate, Rapl, gpu, told
from jouleswarm.common.scenario.measure import Measure
from jouleswarm.common.wire.topics import weights

SECOND = 1_000_000_000


class Clocks:
    """Of the wall and of CPU time, which only move when they are told to."""

    def __init__(self) -> None:
        self.wall = self.cpu = 0

    def spend(self, wall_s: float, cpu_s: float) -> None:
        self.wall += round(wall_s * SECOND)
        self.cpu += round(cpu_s * SECOND)


class TenWatts:
    how = "made up"

    def joules(self, cpu_s: float) -> float:
        return 10 * cpu_s


class Card:
    """A GPU's counter: 100 J between any two readings."""

    how = "nvml"

    def joules(self) -> float:
        return 100.0


def metered(meter: Meter, clocks: Clocks, card: Card | None = None) -> JouleMeter:
    meter.energy = JouleMeter(meter._cell, TenWatts(), card, (lambda: clocks.wall, lambda: clocks.cpu))  # type: ignore[arg-type]
    return meter.energy


def told_of(meter: Meter, client: str = "agent-1") -> dict[tuple[str, ...], tuple[float, float]]:
    rows = meter.joules(client)
    return {(row.phase, row.arm, row.activity, row.how): (row.seconds, row.joules) for row in rows}


def test_joules_go_to_the_arm_and_the_activity_in_which_they_were_drawn() -> None:
    meter, clocks = Meter("client"), Clocks()
    energy = metered(meter, clocks)
    clocks.spend(2, 1)  # start: 1 s of CPU time at 10 W
    energy.enter("fl", "maml")
    with energy.during("learning"):
        clocks.spend(3, 2.5)
        with energy.during("communication"):
            clocks.spend(1, 0.5)
        clocks.spend(1, 1)
    with energy.during("idle"):
        clocks.spend(4, 0.1)
    clocks.spend(0.5, 0.2)
    assert told_of(meter) == {
        ("", "", "start", "made up"): (2, pytest.approx(10)),
        ("fl", "maml", "learning", "made up"): (4, pytest.approx(35)),
        ("fl", "maml", "communication", "made up"): (1.5, pytest.approx(7)),
        ("fl", "maml", "idle", "made up"): (4, pytest.approx(1)),
    }


def test_a_gpus_joules_are_shared_out_by_seconds_in_rows_of_their_own() -> None:
    meter, clocks = Meter("client"), Clocks()
    energy = metered(meter, clocks, Card())
    energy.enter("maml", "maml")
    for _ in range(2):  # 0.1 s each, read once at the end: 100 J over 0.2 s
        with energy.during("learning"):
            clocks.spend(0.075, 0)
        clocks.spend(0.025, 0)
    rows = {key: joules for key, (_, joules) in told_of(meter, "datacenter").items() if key[3] == "nvml"}
    assert rows[("maml", "maml", "learning", "nvml")] == pytest.approx(75)
    assert rows[("maml", "maml", "communication", "nvml")] == pytest.approx(25)
    assert {row.role for row in meter.joules("datacenter")} == {"datacenter"}


def test_a_process_that_was_killed_goes_on_from_what_it_had_measured(tmp_path: Path) -> None:
    for _ in range(2):
        meter, clocks = Meter("client", tmp_path), Clocks()
        energy = metered(meter, clocks)
        energy.enter("fl", "fl")
        with energy.during("learning"):
            clocks.spend(1, 1)
        del meter
    (row,) = [row for row in read_joules("agent-3", tmp_path) if row.activity == "learning"]
    assert (row.client, row.role, row.seconds, row.cpu_s, row.joules) == ("agent-3", "robot", 2, 2, 20)


def test_joules_are_no_bytes_and_no_work() -> None:
    meter, clocks = Meter("client"), Clocks()
    metered(meter, clocks).enter("fl", "fl")
    clocks.spend(1, 1)
    meter.count("agent-1", weights("r", "fl", 1, 1), "out", 10, 20)
    assert meter.joules("agent-1")
    assert [row.payload_bytes for row in meter.rows()] == [10]
    assert meter.work("agent-1") == []


def test_who_is_not_asked_measures_nothing() -> None:
    meter = Meter("client")
    meter.measure(Measure())
    meter.energy.enter("fl", "fl")
    with meter.energy.during("learning"):
        pass
    assert meter.joules("agent-1") == []


def test_without_a_counter_joules_are_estimated_by_cpu_time_and_the_line_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings = Measure(tdp_w=60, cores=4, share=0.8)  # 60 x 0.8 / 4 = 12 W a busy core
    assert Estimate(settings).joules(2.5) == pytest.approx(30)
    monkeypatch.setattr("jouleswarm.common.meter.power.Rapl.__init__", missing)
    line = told(settings)
    assert "no readable counter here" in line
    assert "estimated: CPU time x 12 W" in line
    assert "measure.tdp_w 60 x share 0.8 / 4 cores" in line


def missing(self: Rapl) -> None:
    raise FileNotFoundError("no package")


@pytest.fixture
def rapl(tmp_path: Path) -> Path:
    """A processor of two packages, as Linux shows it; and one core's zone, which is part of the first."""
    for name, kind in {"intel-rapl:0": "package-0", "intel-rapl:1": "package-1", "intel-rapl:0:0": "core"}.items():
        zone = tmp_path / name
        zone.mkdir()
        (zone / "name").write_text(f"{kind}\n")
        (zone / "energy_uj").write_text("9000000\n")
        (zone / "max_energy_range_uj").write_text("9999999\n")
    (tmp_path / "stat").write_text("cpu  100 0 100 5000 50 0 0 0 0 0\ncpu0 1 1 1 1\n")
    return tmp_path


def test_a_packages_joules_are_a_processs_by_its_share_of_the_machines_cpu_time(
    rapl: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sysconf", lambda name: 100)  # ticks a second
    counter = Rapl(rapl, rapl / "stat")
    (rapl / "intel-rapl:0" / "energy_uj").write_text("1000000\n")  # it began again: 1 J to 10 J, and 1 J
    (rapl / "intel-rapl:1" / "energy_uj").write_text("9500000\n")  # 0.5 J
    (rapl / "stat").write_text("cpu  200 0 300 9000 90 0 0 0 0 0\n")  # 1 s + 2 s busy, whatever was idle
    assert counter.joules(1.2) == pytest.approx(2.5 * 1.2 / 3)
    (rapl / "intel-rapl:0" / "energy_uj").write_text("1300000\n")
    assert counter.joules(0.004) == pytest.approx(0.3)  # less than a tick: all of it was this process's
    assert counter.joules(0.0) == 0.0


def test_a_counter_that_may_not_be_read_is_none(rapl: Path) -> None:
    for zone in rapl.glob("intel-rapl:*"):
        (zone / "energy_uj").unlink()
    with pytest.raises(OSError):
        Rapl(rapl, rapl / "stat")
    with pytest.raises(FileNotFoundError, match="no package"):
        Rapl(rapl / "nowhere")


class NVMLError(Exception):
    pass


def nvml(read: object) -> SimpleNamespace:
    return SimpleNamespace(
        nvmlInit=lambda: None,
        nvmlDeviceGetHandleByUUID=lambda uuid: uuid,
        nvmlDeviceGetTotalEnergyConsumption=read,
        NVMLError=NVMLError,
    )


def test_a_gpu_is_read_by_its_own_counter_in_millijoules(monkeypatch: pytest.MonkeyPatch) -> None:
    readings = {"GPU-7": iter([5000, 7500, 7600])}
    monkeypatch.setitem(sys.modules, "pynvml", nvml(lambda handle: next(readings[handle])))
    card = gpu("7")
    assert card is not None
    assert (card.joules(), card.joules()) == (2.5, pytest.approx(0.1))


def test_a_gpu_without_a_counter_is_told_and_not_guessed(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(handle: str) -> int:
        raise NVMLError("Not Supported")

    assert gpu(None) is None
    monkeypatch.setitem(sys.modules, "pynvml", nvml(refuse))
    with caplog.at_level(logging.WARNING):
        assert gpu("7") is None
    monkeypatch.setitem(sys.modules, "pynvml", None)
    assert gpu("7") is None
    assert "NVML: Not Supported" in caplog.text
    assert "pip install jouleswarm[measure]" in caplog.text
