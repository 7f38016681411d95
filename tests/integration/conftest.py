"""Real processes on this machine: `jouleswarm run`, and brokers, robots, data center and recorder started by hand."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import shutil
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
import pytest
import safetensors.numpy

from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.models import encode_model
from jouleswarm.common.wire.saved_models import check_model
from jouleswarm.methods.shipped import all_shipped

ROOT = Path(__file__).parents[2]
TOY = ROOT / "scenarios" / "toy.toml"
DEADLINE_S = 150.0
# No robot can reach a target of 1000: every arm lasts its 3 rounds.
SMALL = (
    "federation.max_rounds=3", "federation.target_reward=1000", "meta.t0=2",
    "learning.motions_per_round=6", "learning.batches_per_round=4",
)  # fmt: skip


def sets(*overrides: str) -> list[str]:
    return [part for each in overrides for part in ("--set", each)]


def on_the_wire(saved: bytes, robots: int = 2) -> bytes:
    """A model of the run directory as it went to neighbours."""
    fields = check_model(saved).model_dump(include=set(ModelHeader.model_fields) - {"schema_"})
    tensors = safetensors.numpy.load(saved)
    # The library gives them in random order, and the length of the header's offsets depends on the order.
    (length,) = struct.unpack_from("<Q", saved)
    in_order = [name for name in json.loads(saved[8 : 8 + length]) if name != "__metadata__"]
    ordered = {name: tensors[name] for name in in_order}
    return encode_model(ordered, ModelHeader.model_validate(fields), robots)


def free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


def wait_until(condition: Callable[[], bool], what: str, within_s: float = DEADLINE_S) -> None:
    """For what happens in another process and makes no event here."""
    deadline_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline_s, f"not within {within_s} s: {what}"
        time.sleep(0.02)


def _hear_ctrl_c() -> None:
    # A shell starts a background job deaf to SIGINT, and its children inherit that: so may these tests.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@dataclass
class Started:
    """A process and all that it prints."""

    process: subprocess.Popen[str]
    output: Path

    @property
    def printed(self) -> str:
        return self.output.read_text()

    def ends(self, within_s: float = DEADLINE_S) -> int:
        """Exit code."""
        try:
            return self.process.wait(within_s)
        except subprocess.TimeoutExpired:
            pytest.fail(f"{self.process.args} has not ended; it printed:\n{self.printed}")

    @property
    def family(self) -> list[psutil.Process]:
        """The process and all its children, however deep."""
        root = psutil.Process(self.process.pid)
        return [root, *root.children(recursive=True)]


@dataclass
class Starter:
    """Starts processes; whatever still runs at the end is ended."""

    folder: Path
    started: list[Started] = field(default_factory=list)

    def __call__(self, *command: str, **environment: str) -> Started:
        output = self.folder / f"output-{len(self.started)}.txt"
        with output.open("w") as file:
            process = subprocess.Popen(
                command, cwd=ROOT, stdout=file, stderr=subprocess.STDOUT, text=True,
                env={**os.environ, "COLUMNS": "100", **environment}, start_new_session=True, preexec_fn=_hear_ctrl_c,
            )  # fmt: skip
        self.started.append(Started(process, output))
        return self.started[-1]

    def python(self, *arguments: str, **environment: str) -> Started:
        return self(sys.executable, "-m", *arguments, **environment)

    def jouleswarm(self, *arguments: str, **environment: str) -> Started:
        return self.python("jouleswarm", *arguments, **environment)

    def end(self) -> None:
        for each in self.started:
            if each.process.poll() is None:
                for process in each.family:
                    with contextlib.suppress(psutil.NoSuchProcess):
                        process.kill()
                each.process.wait(10)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Starter]:
    starter = Starter(tmp_path)
    yield starter
    starter.end()


@pytest.fixture(scope="module")
def starter(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Starter]:
    """As `start`, for all tests of a file."""
    starter = Starter(tmp_path_factory.mktemp("started"))
    yield starter
    starter.end()


@dataclass
class Run:
    """A finished run directory."""

    path: Path
    printed: str

    @property
    def summary(self) -> dict[str, Any]:
        return dict(json.loads((self.path / "summary.json").read_text()))

    @property
    def manifest(self) -> dict[str, Any]:
        return dict(json.loads((self.path / "manifest.json").read_text()))

    def lines(self, name: str) -> list[dict[str, Any]]:
        return [json.loads(line) for line in (self.path / name).read_text().splitlines()]

    @property
    def figures(self) -> list[dict[str, Any]]:
        """rounds.jsonl but seconds."""
        return [{key: value for key, value in row.items() if key != "seconds"} for row in self.lines("rounds.jsonl")]

    @property
    def weights(self) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in (self.path / "weights").iterdir()}


RunToy = Callable[..., Run]


@pytest.fixture(scope="session")
def read_run() -> Callable[..., Run]:
    return lambda path, printed="": Run(path, printed)


@pytest.fixture(scope="session")
def run_toy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunToy]:
    """Runs `jouleswarm run scenarios/toy.toml` to its end, once for all of xdist's workers: nobody may change it."""
    own = tmp_path_factory.getbasetemp()
    out = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "shared-runs"
    out.mkdir(exist_ok=True)
    starter = Starter(tmp_path_factory.mktemp("printed"))

    def run(name: str, *overrides: str, options: tuple[str, ...] = ("--no-figures",)) -> Run:
        printed = out / f"{name}.txt"
        with (out / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not printed.exists():
                where = ("--out", str(out), "--run-id", name)
                started = starter.jouleswarm("run", str(TOY), *where, *options, *sets(*overrides))
                assert started.ends() == 0, started.printed
                printed.write_text(started.printed)
        return Run(out / name, printed.read_text())

    yield run
    starter.end()


@pytest.fixture(scope="session")
def toy_run(run_toy: RunToy) -> Run:
    """The whole toy scenario, both arms, as a user would run it."""
    return run_toy("toy", options=())


@pytest.fixture(scope="session")
def small() -> tuple[str, ...]:
    """What makes the toy scenario smaller still."""
    return SMALL


@pytest.fixture(scope="session")
def small_run(run_toy: RunToy) -> Run:
    """Three rounds an arm, embedded broker, QoS 1: what runs by other ways are held against."""
    return run_toy("small", *SMALL)


@pytest.fixture(scope="session")
def methods_run(run_toy: RunToy) -> Run:
    """Every method, and an arm from a meta-model on the way, in one deployment."""
    return run_toy("methods", *SMALL, f"methods={list(all_shipped())}", "meta.adapt_from=[1]")


@pytest.fixture
def broker(start: Starter) -> str:
    """A broker started by hand; returns its URL."""
    port = free_port()
    start.python("broker", "--port", str(port), "--no-metrics")
    return listening(port)


def listening(port: int) -> str:
    def answers() -> bool:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1):
            return True
        return False

    wait_until(answers, f"a broker on port {port}", 20)
    return f"mqtt://127.0.0.1:{port}"


@pytest.fixture
def mosquitto_with(start: Starter, tmp_path: Path) -> Callable[[str], str]:
    """Starts a Mosquitto broker with further lines in its settings; returns its URL, as if without TLS."""
    program = shutil.which("mosquitto", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")
    if program is None:
        pytest.skip("mosquitto is not installed")

    def run(lines: str) -> str:
        port, settings = free_port(), tmp_path / "mosquitto.conf"
        # As root it would become another user, who cannot read a private key.
        settings.write_text(f"user root\nlistener {port} 127.0.0.1\nset_tcp_nodelay true\n{lines}")
        start(program, "-c", str(settings))
        return listening(port)

    return run


@pytest.fixture
def mosquitto(mosquitto_with: Callable[[str], str]) -> str:
    """A Mosquitto broker; returns its URL."""
    return mosquitto_with("allow_anonymous true\n")


@pytest.fixture
def onlooker() -> Iterator[Callable[..., MqttBus]]:
    """Connects clients that are no part of a run."""
    buses: list[MqttBus] = []

    def connect(url: str, *filters: str) -> MqttBus:
        buses.append(MqttBus.connect(url, f"onlooker-{len(buses)}", connect_timeout_s=20))
        if filters:
            buses[-1].subscribe(*filters)
        return buses[-1]

    yield connect
    for bus in buses:
        with contextlib.suppress(Exception):
            bus.close()


@dataclass
class ByHand:
    """The processes of a small run, started one by one."""

    start: Starter
    url: str
    out: Path
    name: str = "by-hand"
    overrides: tuple[str, ...] = SMALL
    options: tuple[str, ...] = ()

    @property
    def _common(self) -> list[str]:
        common = ["--broker", self.url, *self.options, *sets(*self.overrides)]
        return ["--scenario", str(TOY), "--run", self.name, *common]

    def recorder(self) -> Started:
        """Returns when it listens."""
        started = self.start.jouleswarm(
            "record", str(TOY), "--broker", self.url, "--run-id", self.name, "--out", str(self.out), "--no-figures",
            *self.options, *sets(*self.overrides),
        )  # fmt: skip
        wait_until((self.out / self.name / "manifest.json").exists, "the recorder to listen")
        return started

    def robot(self, agent: int, *options: str) -> Started:
        return self.start.python("jouleswarm.agents", "--id", str(agent), *self._common, *options)

    def data_center(self, *options: str) -> Started:
        return self.start.python("jouleswarm.datacenter", *self._common, *options)

    def run(self, recorder: Started) -> Run:
        """The run directory, once the recorder has ended well."""
        assert recorder.ends() == 0, recorder.printed
        return Run(self.out / self.name, recorder.printed)


@pytest.fixture
def by_hand(start: Starter, tmp_path: Path) -> Callable[..., ByHand]:
    return lambda url, **options: ByHand(start, url, tmp_path / "out", **options)


@pytest.fixture
def eventually() -> Callable[..., None]:
    return wait_until
