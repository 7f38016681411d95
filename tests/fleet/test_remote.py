"""Groups of processes as tasks of Dask: begun, told, failed, cancelled; the processes themselves are made up."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self

import pytest
from distributed import Client, LocalCluster

from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.errors import RunError
from jouleswarm.fleet import worker as module
from jouleswarm.fleet.remote import Remote

DEADLINE_S = 30.0
PROCESSES = {name: ("jouleswarm.agents", ["--id", name]) for name in ("agent-1", "agent-2", "agent-3")}


class MadeUp:
    """In place of a launcher: what it was to start, and whether it has been left."""

    started: dict[str, str]
    left: threading.Event
    error: str | None

    def __init__(
        self, logs: Path, restarts: int, told: Callable[[str], None], may_miss: Any, fork_server: str, scenario: Path
    ) -> None:
        self.log, self.told, self.scenario = fork_server, told, scenario

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.left.set()

    def start(self, name: str, module: str, arguments: list[str]) -> None:
        self.started[name] = f"{self.log} of {self.scenario.relative_to(self.scenario.parents[1])}"

    is_at_work = True

    def check(self) -> None:
        if self.error:
            self.told("agent-1 was ended by SIGKILL; starting it again")
            raise RunError(self.error)


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> type[MadeUp]:
    MadeUp.started, MadeUp.left, MadeUp.error = {}, threading.Event(), None
    monkeypatch.setattr(module, "Launcher", MadeUp)
    monkeypatch.setattr(module, "_LOOK_EVERY_S", 0.01)
    return MadeUp


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    """Of two workers of one thread each, in this process."""
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0") as cluster,
        Client(cluster) as client,
    ):
        yield client


def until(condition: Callable[[], bool], remote: Remote) -> None:
    deadline_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline_s
        remote.check()
        time.sleep(0.01)


def test_each_worker_has_its_processes_and_a_run_that_is_left_ends_them_all(
    client: Client, made_up: type[MadeUp], tmp_path: Path
) -> None:
    told: list[str] = []
    with Remote(client, tmp_path / "r", tmp_path / "state", 1, told.append, goes_on=False) as remote:
        remote.start(PROCESSES)
        until(lambda: len(made_up.started) == 3 and len(told) == 2, remote)
        assert not made_up.left.is_set()
    assert made_up.left.wait(DEADLINE_S)
    first, second = sorted(client.nthreads())
    assert sorted(told) == [f"worker {first}: agent-1, agent-3", f"worker {second}: agent-2"]
    first, second = (f"fork-server-{group} of r/manifest.json" for group in (1, 2))
    assert made_up.started == {"agent-1": first, "agent-3": first, "agent-2": second}


def test_a_process_that_fails_on_a_worker_ends_the_run_with_its_last_words(
    client: Client, made_up: type[MadeUp], tmp_path: Path
) -> None:
    made_up.error, told = "agent-1 ended with code 4: a loss that is not finite", list[str]()
    with Remote(client, tmp_path / "r", tmp_path / "state", 1, told.append, goes_on=False) as remote:
        remote.start({"agent-1": PROCESSES["agent-1"]})
        with pytest.raises(RunError, match="agent-1 ended with code 4: a loss that is not finite"):
            until(lambda: False, remote)
    (worker, *_) = sorted(client.nthreads())
    assert told == [f"worker {worker}: agent-1", f"worker {worker}: agent-1 was ended by SIGKILL; starting it again"]


def test_a_group_waits_for_processes_that_still_hold_their_states_elsewhere(
    client: Client, made_up: type[MadeUp], tmp_path: Path
) -> None:
    told: list[str] = []
    with Remote(client, tmp_path / "r", tmp_path / "state", 1, told.append, goes_on=False) as remote:
        with Lock(tmp_path / "state" / "agent-1", "one that is cut off"):
            remote.start({"agent-1": PROCESSES["agent-1"]})
            until(lambda: len(told) == 2, remote)
            assert told[1].endswith(": waiting for agent-1 to end where it was before")
            assert not made_up.started
        until(lambda: bool(made_up.started), remote)


def test_what_a_worker_has_that_is_asked_to_leave_is_begun_again_on_another(
    client: Client, made_up: type[MadeUp], tmp_path: Path
) -> None:
    told: list[str] = []
    leaving, staying = sorted(client.nthreads())
    with Remote(client, tmp_path / "r", tmp_path / "state", 1, told.append, goes_on=False) as remote:
        remote.start({"agent-1": PROCESSES["agent-1"]})
        until(lambda: "agent-1" in made_up.started, remote)
        client.retire_workers([leaving])
        until(lambda: f"worker {staying} goes on with agent-1" in told, remote)
    assert told[0] == f"worker {leaving}: agent-1"
