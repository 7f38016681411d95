"""Whole runs over the in-memory bus in which a robot or the data center is killed and comes back: the same end."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from jouleswarm.agents.robot import run_agent
from jouleswarm.common.bus.bus import MemoryBus, MemoryHub
from jouleswarm.common.bus.reporter import MAX_REPORT_BYTES, MeterReport, Telemetry
from jouleswarm.common.disk.state import Keep
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Presence, decode_json, encode_json
from jouleswarm.datacenter.center import run_datacenter
from jouleswarm.simulation import run_in_memory

TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"  # 2 tasks, 2 robots each; robot 1 sends experience
DEADLINE_S = 100.0
SMALL = (
    "federation.max_rounds=3", "federation.target_reward=1000", "meta.t0=2", "learning.motions_per_round=6",
    "learning.batches_per_round=4", "bus.resend_after_s=0.05",
)  # fmt: skip


class Killed(BaseException):
    """So to speak: nothing of ours may catch it."""


class Death(NamedTuple):
    """Comes over `client` with its `count`-th message on a topic that ends in `word`."""

    client: str
    word: str
    count: int
    sent: bool = False
    """Whether the message still goes out."""


class End(NamedTuple):
    """What must be the same."""

    rows: frozenset[str]
    models: dict[str, bytes]


def mortal(bus: MemoryBus, death: Death) -> None:
    publish, left = bus.publish, death.count

    def publish_or_die(topic: str, payload: bytes, **options: bool) -> None:
        nonlocal left
        left -= topic.endswith(f"/{death.word}")
        if left == 0 and not death.sent:
            raise Killed
        publish(topic, payload, **options)
        if left == 0:
            raise Killed

    bus.publish = publish_or_die  # type: ignore[method-assign,assignment]


class Deployment:
    """Data center and robots as threads, each with a state folder."""

    def __init__(self, scenario: Scenario, folder: Path) -> None:
        self.scenario, self.folder, self.hub = scenario, folder, MemoryHub()
        self.recorder = self.hub.connect("recorder")
        self.recorder.subscribe(*(each("r", "+", "+") for each in (topics.telemetry, topics.learned, topics.snapshot)))
        self.errors: list[BaseException] = []
        self.died: list[str] = []

    def run(self, death: Death) -> End:
        bodies: dict[str, Callable[[MemoryBus, Keep], None]] = {
            f"agent-{agent}": functools.partial(run_agent, self.scenario, agent, "r") for agent in self.scenario.agents
        }
        if self.scenario.needs_datacenter:
            bodies["datacenter"] = functools.partial(run_datacenter, self.scenario, "r")
        threads = [
            threading.Thread(target=self._process, args=(client, body, death), daemon=True)
            for client, body in bodies.items()
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(DEADLINE_S)
            assert self.errors == []
            assert not thread.is_alive()
        assert self.died == [death.client]
        return self._end()

    def _process(self, client: str, body: Callable[[MemoryBus, Keep], None], death: Death) -> None:
        use_one_thread()
        try:
            bus = self._connect(client)
            if client == death.client:
                mortal(bus, death)
            try:
                body(bus, Keep(self.folder / client))
            except Killed:
                self.died.append(client)
                bus = self._connect(client)
                self._will(client)
                body(bus, Keep(self.folder / client))
        except BaseException as error:
            self.errors.append(error)
            raise

    def _connect(self, client: str) -> MemoryBus:
        bus = self.hub.connect(client)
        bus.meter = Meter("client", self.folder / client)
        return bus

    def _will(self, client: str) -> None:
        agent = int(client.removeprefix("agent-")) if client != "datacenter" else 0
        task = self.scenario.task_of(agent) if agent else 0
        gone = encode_json(Presence(agent=agent, state="gone"))
        self.hub.connect("will").publish(topics.presence("r", task, agent), gone, retain=True)

    def _end(self) -> End:
        rows, models = set(), {}
        while message := self.recorder.receive(0.001):
            if message.topic.endswith("/round"):
                rows.add(decode_json(message.payload, Telemetry).row.model_dump_json(exclude={"seconds", "refused"}))
            else:
                models[message.topic.removeprefix("jouleswarm/r/")] = bytes(message.payload)
        return End(frozenset(rows), models)


@functools.cache
def undisturbed(overrides: tuple[str, ...]) -> End:
    outcome = run_in_memory(load_scenario(TOY, [*SMALL, *overrides]))
    rows = frozenset(row.model_dump_json(exclude={"seconds", "refused"}) for row in outcome.rows)
    learned = {f"{arm}/tlm/{task}/learned": payload for (arm, task), payload in outcome.learned.items()}
    snapshots = {f"{arm}/tlm/{round_}/snapshot": payload for (arm, round_), payload in outcome.snapshots.items()}
    return End(rows, learned | snapshots)


ROBOT, CENTER = "agent-1", "datacenter"
FL, FEDAVG, CENTRALIZED, FOMAML, MULTITASK = (
    f"methods=['{method}']" for method in ("fl", "fedavg", "centralized", "fomaml", "multitask")
)
FLOAT32, TOPK = "federation.codec='float32'", "federation.codec='topk'"
CASES = [
    (FL, FLOAT32, Death(ROBOT, "weights", 2)),  # with the first round on disk, the second's weights not sent
    (FL, TOPK, Death(ROBOT, "weights", 2, sent=True)),  # the neighbour has them, and gets them again
    (FL, TOPK, Death(ROBOT, "weights", 3)),
    (FL, TOPK, Death(ROBOT, "weights", 1, sent=True)),  # nothing but the start on disk
    (FL, TOPK, Death(ROBOT, "round", 3, sent=True)),  # told, and done again
    (FL, TOPK, Death(ROBOT, "learned", 1, sent=True)),
    (FL, FLOAT32, Death(ROBOT, "presence", 1)),  # before anybody knew of it
    (FL, FLOAT32, Death(ROBOT, "presence", 4, sent=True)),  # its neighbour need not wait for it, nor it for that one
    (FL, FLOAT32, Death(ROBOT, "presence", 5, sent=True)),  # done, and back
    (FEDAVG, FLOAT32, Death(ROBOT, "weights", 2)),
    (FEDAVG, TOPK, Death(ROBOT, "weights", 2, sent=True)),
    (FEDAVG, TOPK, Death(ROBOT, "weights", 3)),
    (FEDAVG, TOPK, Death(CENTER, "model", 2)),  # the answer is on disk, and nobody has it
    (FEDAVG, TOPK, Death(CENTER, "model", 3, sent=True)),
    (CENTRALIZED, FLOAT32, Death(ROBOT, "transition", 9)),  # in the middle of the second round
    (CENTRALIZED, TOPK, Death(ROBOT, "episode", 2)),
    (CENTRALIZED, TOPK, Death(ROBOT, "episode", 2, sent=True)),
    (CENTRALIZED, TOPK, Death(CENTER, "model", 3)),
    (CENTRALIZED, FLOAT32, Death(CENTER, "round", 3)),  # learned, and nothing of it on disk
    (FOMAML, TOPK, Death(ROBOT, "experience", 9)),
    (FOMAML, TOPK, Death(CENTER, "round", 2)),
    (FOMAML, FLOAT32, Death(CENTER, "meta", 1)),  # the last round is on disk, the meta-model not sent
    (MULTITASK, FLOAT32, Death(ROBOT, "weights", 2)),
    (MULTITASK, TOPK, Death(CENTER, "meta", 1, sent=True)),
]


@pytest.mark.parametrize(("method", "codec", "death"), CASES, ids=str)
def test_who_is_killed_and_comes_back_changes_nothing_to_the_bit(
    method: str, codec: str, death: Death, tmp_path: Path
) -> None:
    overrides = method, codec
    deployment = Deployment(load_scenario(TOY, [*SMALL, *overrides]), tmp_path)
    assert deployment.run(death) == undisturbed(overrides)
    assert list(tmp_path.iterdir()) == []  # no state is left


def test_a_robot_that_is_killed_in_its_second_arm_does_not_do_the_first_again(tmp_path: Path) -> None:
    overrides = ("methods=['fl', 'fedavg']", "bus.resend_after_s=60")  # no weights are sent because of impatience
    deployment = Deployment(load_scenario(TOY, [*SMALL, *overrides]), tmp_path)
    assert deployment.run(Death(ROBOT, "weights", 5)) == undisturbed(overrides)  # 3 of fl and 2 of fedavg
    told = {row.topic: row.messages for row in deployment.hub.meter.rows() if row.client == "recorder"}
    assert told[topics.telemetry("r", "fl", ROBOT)] == 4  # with round 0


@pytest.mark.parametrize(
    ("method", "death", "done"),
    [
        # 3 rounds of 4 gradients and 6 motions, and the second's again: killed with its weights unsent
        (FL, Death(ROBOT, "weights", 2), [("fl", 16, 0, 24)]),
        # 2 rounds of 4 + 4 gradients, and the second's again: its row was not told
        (FOMAML, Death(CENTER, "round", 2), [("maml", 12, 12, 0)]),
        # 3 rounds of 6 motions, and of the second the first 3 again: the third was made and not sent
        (CENTRALIZED, Death(ROBOT, "transition", 9), [("fl", 0, 0, 21)]),
    ],
)
def test_what_is_done_again_is_counted_again(
    method: str, death: Death, done: list[tuple[str, int, int, int]], tmp_path: Path
) -> None:
    # Impatience would make robots send, and count against their death, what had come.
    patient = ["bus.resend_after_s=60"] if death.client == ROBOT else []
    deployment = Deployment(load_scenario(TOY, [*SMALL, method, *patient]), tmp_path)
    ears = deployment.hub.connect("ears")
    ears.subscribe(topics.meter_report("r", death.client))
    deployment.run(death)
    message = ears.receive(0)
    assert message is not None
    told = decode_json(message.payload, MeterReport, MAX_REPORT_BYTES).work
    assert [(row.phase, row.gradients, row.gradients_query, row.motions) for row in told] == done
