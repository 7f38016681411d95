"""Flower apps of two clients, metered: our example in the simulation and in the deployment engine, and Flower's own."""

from __future__ import annotations

import asyncio
import contextlib
import csv
import os
import re
import shutil
import socket
import threading
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import pytest

from jouleswarm import Run, bill
from jouleswarm.metering.metered import load_metered
from tests.integration.conftest import Started, Starter, free_port, wait_until

ROOT = Path(__file__).parents[2]
BIN = ROOT / ".venv-flower" / "bin"
ALONE = {  # nothing outside this machine is asked, told or installed
    "FLWR_TELEMETRY_ENABLED": "0", "FLWR_DISABLE_UPDATE_CHECK": "1", "RAY_USAGE_STATS_ENABLED": "0",
    "FLWR_DISABLE_RUNTIME_DEPENDENCY_INSTALLATION": "1", "PATH": f"{BIN}:{os.environ['PATH']}",
}  # fmt: skip
DEADLINE_S = 250.0
CLIENTS = ("client-0", "client-1")
SMALL = (64 * 10 + 10) * 4  # bytes of float32 weights [64, 10] and bias [10]
FEATURES = 200_000
LARGE = (FEATURES * 10 + 10) * 4

pytestmark = [
    pytest.mark.flower,
    pytest.mark.timeout(600),  # Ray and a dozen processes to start, on a machine that may have much else to do
    pytest.mark.skipif(not BIN.exists(), reason="no Flower: `make flower`"),
]


class Relay:
    """Passes TCP connections on to a port, and counts bytes both ways."""

    def __init__(self, port: int) -> None:
        self.up = self.down = 0
        self._to, self._listening = port, threading.Event()
        threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True).start()
        assert self._listening.wait(10)

    async def _serve(self) -> None:
        server = await asyncio.start_server(self._connect, "127.0.0.1", 0)
        self.port = int(server.sockets[0].getsockname()[1])
        self._listening.set()
        await server.serve_forever()

    async def _connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        from_server, to_server = await asyncio.open_connection("127.0.0.1", self._to)
        await asyncio.gather(self._pass(reader, to_server, "up"), self._pass(from_server, writer, "down"))

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, way: str) -> None:
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(1 << 16):
                setattr(self, way, getattr(self, way) + len(data))
                writer.write(data)
                await writer.drain()
        writer.close()


def is_open(port: int) -> bool:
    with socket.socket() as sock:
        return sock.connect_ex(("127.0.0.1", port)) == 0


def sums(folder: Path, *columns: str) -> dict[tuple[str, ...], float]:
    """Of a run directory: values by columns."""
    found: dict[tuple[str, ...], float] = defaultdict(float)
    with (folder / "counts.csv").open(newline="") as rows:
        for row in csv.DictReader(rows):
            found[tuple(row[column] for column in columns)] += float(row["value"])
    return found


class Flower:
    """SuperLinks, each in a folder of its own, where runs leave their directories."""

    def __init__(self, starter: Starter, folder: Path) -> None:
        self.folder, self._starter = folder, starter
        self._environment = ALONE | {"FLWR_HOME": str(folder / "home")}
        (folder / "home").mkdir()

    def __call__(self, folder: Path, *command: str) -> Started:
        return self._starter("env", f"--chdir={folder}", *command, **self._environment)

    def link(self, name: str, *options: str) -> int:
        """Start a SuperLink; its port."""
        folder, port = self.folder / name, free_port()
        folder.mkdir()
        link = self(folder, "flower-superlink", "--insecure", "--port", str(port), *options)
        wait_until(lambda: is_open(port) or link.process.poll() is not None, "SuperLink")
        assert link.process.poll() is None, link.printed
        with (self.folder / "home" / "config.toml").open("a") as file:
            file.write(f'[superlink.{name}]\naddress = "127.0.0.1:{port}"\ninsecure = true\n')
        return port

    def node(self, port: int, partition: int) -> None:
        """Start a SuperNode whose SuperLink is at a port."""
        options = ("--superlink", f"127.0.0.1:{port}", "--node-config", f"partition-id={partition}")
        self(self.folder, "flower-supernode", "--insecure", "--port", str(free_port()), *options)

    def run(self, app: Path, link: str, config: str) -> Started:
        """Begin a run."""
        return self(self.folder, "flwr", "run", str(app), link, "--stream", "--run-config", config)

    def done(self, run: Started, link: str) -> Path:
        """Its directory, once it has ended."""
        assert run.ends(DEADLINE_S) == 0, run.printed
        number = re.search(r"started run (\d+)", run.printed)
        assert number, run.printed
        folder = self.folder / link / "runs" / f"flower-{number[1]}"
        assert (folder / "counts.csv").exists(), run.printed
        return folder


class Done(NamedTuple):
    """Run directories, and what SuperNodes and SuperLink exchanged for the deployed one."""

    simulated: Path
    template: Path
    deployed: Path
    relays: tuple[Relay, Relay]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, starter: Starter) -> Done:
    flower = Flower(starter, tmp_path_factory.mktemp("flower"))
    shutil.copytree(ROOT / "examples" / "flower", flower.folder / "app")
    flower.link("simulation", "--simulation")
    port = flower.link("deployment")
    relays = Relay(port), Relay(port)
    for partition, relay in enumerate(relays):
        flower.node(relay.port, partition)
    deployed = flower.run(flower.folder / "app", "deployment", f"features={FEATURES} steps=1 rounds=1")
    simulated = flower.done(flower.run(flower.folder / "app", "simulation", "rounds=3"), "simulation")
    own = with_two_lines(shutil.copytree(ROOT / "tests" / "flower" / "quickstart", flower.folder / "quickstart"))
    deployed_run = flower.done(deployed, "deployment")
    template = flower.done(flower.run(own, "deployment", "num-server-rounds=1"), "deployment")
    return Done(simulated, template, deployed_run, relays)


def with_two_lines(app: Path) -> Path:
    """An app with the meter in it: on each side one line, and its import."""
    for name, imported, line, ours in (
        ("client_app", "meter_mod", "app = ClientApp()", "app = ClientApp(mods=[meter_mod])"),
        ("server_app", "metered", "strategy = FedAvg()", "strategy = metered(FedAvg())"),
    ):
        file = app / "quickstart" / f"{name}.py"
        head, found, rest = file.read_text().partition(line)
        assert found
        file.write_text(
            f"{head}{ours}{rest}".replace("\nimport", f"\nfrom jouleswarm.flower import {imported}\nimport", 1)
        )
    return app


def test_arrays_and_messages_are_counted_by_client_and_round(done: Done) -> None:
    found = sums(done.simulated, "what", "robot", "activity", "round")
    for client in CLIENTS:
        for round_ in ("1", "2", "3"):
            train, evaluate = (client, "train", round_), (client, "evaluate", round_)
            for what in ("downlink_array_bytes", "uplink_array_bytes"):
                assert found[(what, *train)] == SMALL
            assert found[("downlink_array_bytes", *evaluate)] == SMALL
            assert ("uplink_array_bytes", *evaluate) not in found  # metrics only
            for what in ("downlink_messages", "uplink_messages"):
                assert found[(what, *train)] == found[(what, *evaluate)] == 1
            assert SMALL < found[("downlink_bytes", *train)] < SMALL + 1000
            assert 0 < found[("uplink_bytes", *evaluate)] < 1000
            assert found[("gradients", *train)] == 20  # as the app has told
            assert found[("seconds", *train)] > 0
            assert found[("joules", *train)] > 0


def test_a_bill_comes_of_the_directory(done: Done) -> None:
    joules = Run(done.simulated).bill()["fl"].loc["FedAvg"]
    moved = sums(done.simulated, "what")
    assert bill(done.simulated)["fl"].loc["FedAvg"].to_list() == joules.to_list()
    assert load_metered(done.simulated).is_complete
    assert joules["computing_robots"] == pytest.approx(2 * 3 * 20 * 5.1 * 0.4)
    assert joules["uplink"] == pytest.approx(moved[("uplink_bytes",)] * 8 / 200e3)


def test_a_deployed_app_moves_what_is_counted_within_2_percent(done: Done) -> None:
    found = sums(done.deployed, "what", "robot")
    for client, relay in zip(CLIENTS, done.relays, strict=True):
        assert found["downlink_array_bytes", client] == 2 * LARGE  # to train on, and to evaluate
        assert found["uplink_array_bytes", client] == LARGE
        assert relay.down == pytest.approx(found["downlink_bytes", client], rel=0.02)
        assert relay.up == pytest.approx(found["uplink_bytes", client], rel=0.02)
        assert found["seconds", client] > 0


def test_an_app_from_flowers_templates_is_metered_by_two_lines(done: Done) -> None:
    found = sums(done.template, "what", "robot", "activity", "round")
    for client in CLIENTS:
        assert found["downlink_array_bytes", client, "train", "1"] == 8  # one float64
        assert found["uplink_array_bytes", client, "train", "1"] == 8
        assert found["seconds", client, "evaluate", "1"] > 0
    assert {client for _, client, _, _ in found} == set(CLIENTS)
