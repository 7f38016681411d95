"""Done is a state: whole runs over the in-memory bus with a real recorder, whose processes are killed at their end."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.agents.robot import run_agent
from jouleswarm.common.bus.bus import MemoryBus, MemoryHub, Message
from jouleswarm.common.disk.state import Keep
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Presence, encode_json
from jouleswarm.datacenter.center import run_datacenter
from jouleswarm.fleet.recorder import Recorder
from jouleswarm.runs.directory import RunDirectory

TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"  # 2 tasks, 2 robots each
DEADLINE_S = 60.0
SMALL = (
    "federation.max_rounds=3", "federation.target_reward=1000", "learning.motions_per_round=6",
    "learning.batches_per_round=4", "bus.resend_after_s=0.05",
)  # fmt: skip
RUN, DONE = "r", 3  # the stage of who is done with one arm


class Killed(BaseException):
    """So to speak: nothing of ours may catch it."""


class Life:
    """A process as a thread, that can be killed and started again."""

    def __init__(self, hub: MemoryHub, scenario: Scenario, client: str, keep: Keep) -> None:
        self.hub, self.scenario, self.client, self.keep = hub, scenario, client, keep
        self.error: BaseException | None = None
        self._dead = threading.Event()
        self.before: Callable[[str], None] = lambda topic: None
        """Called before each message is sent."""
        self._thread = threading.Thread(target=self._live, daemon=True)

    @property
    def agent(self) -> int:
        return 0 if self.client == "datacenter" else int(self.client.removeprefix("agent-"))

    def start(self) -> Life:
        self._thread.start()
        return self

    def kill(self) -> None:
        """Whatever it does next ends it; its last will is told."""
        self._dead.set()
        self._thread.join(DEADLINE_S)
        task = self.scenario.task_of(self.agent) if self.agent else 0
        gone = encode_json(Presence(agent=self.agent, state="gone"))
        self.hub.connect("will").publish(topics.presence(RUN, task, self.agent), gone, retain=True)

    def again(self) -> Life:
        return Life(self.hub, self.scenario, self.client, self.keep).start()

    def ends(self) -> None:
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive(), f"{self.client} waits for ever"
        assert self.error is None

    @property
    def has_ended(self) -> bool:
        return not self._thread.is_alive()

    def _live(self) -> None:
        use_one_thread()
        bus = self._mortal(self.hub.connect(self.client))
        try:
            if self.agent:
                run_agent(self.scenario, self.agent, RUN, bus, self.keep)
            else:
                run_datacenter(self.scenario, RUN, bus, self.keep)
        except Killed:
            pass
        except BaseException as error:  # noqa: BLE001 - looked at by ends()
            self.error = error

    def _mortal(self, bus: MemoryBus) -> MemoryBus:
        publish, receive = bus.publish, bus.receive

        def publish_or_die(topic: str, payload: bytes, **options: Any) -> None:
            self.before(topic)
            if self._dead.is_set():
                raise Killed
            publish(topic, payload, **options)

        def receive_or_die(timeout_s: float | None = None) -> Message | None:
            if self._dead.is_set():
                raise Killed
            return receive(timeout_s)

        bus.publish, bus.receive = publish_or_die, receive_or_die  # type: ignore[method-assign,assignment]
        return bus


class Deployment:
    """All processes of a run and its recorder, which is this thread."""

    def __init__(self, folder: Path, out: str, method: str, *, keep_state: bool, hub: MemoryHub | None = None) -> None:
        self.scenario = load_scenario(TOY, [*SMALL, f"methods=['{method}']"])
        self.hub, self.directory = hub or MemoryHub(), RunDirectory(folder / out)
        self.directory.manifest({})
        self.recorder = Recorder(self.hub.connect("recorder"), self.scenario, RUN, self.directory)
        clients = [f"agent-{agent}" for agent in self.scenario.agents]
        clients += ["datacenter"] if self.scenario.needs_datacenter else []
        self.lives = {
            client: Life(self.hub, self.scenario, client, Keep(folder / "state" / client, at_the_end=keep_state))
            for client in clients
        }

    def start(self) -> None:
        for life in self.lives.values():
            life.start()

    def pump_until(self, condition: Callable[[], bool], what: str) -> None:
        for _ in range(int(DEADLINE_S / 0.02)):
            if condition():
                return
            assert [life.error for life in self.lives.values() if life.error is not None] == []
            self.recorder.pump(0.02)
        pytest.fail(f"not in {DEADLINE_S} s: {what}; {self.recorder.waits}")

    def complete(self) -> tuple[set[str], dict[str, bytes]]:
        self.pump_until(lambda: not self.recorder.waiting_for, "the end")
        self.recorder.close("complete")
        for life in self.lives.values():
            life.ends()
        rows = {row.model_dump_json(exclude={"seconds", "refused"}) for row in self.directory.rows}
        return rows, {path.name: path.read_bytes() for path in (self.directory.path / "weights").iterdir()}

    @property
    def retained(self) -> list[str]:
        late = self.hub.connect("late")
        late.subscribe("#")
        return [message.topic for message in iter(functools.partial(late.receive, 0.001), None)]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[set[str], dict[str, bytes]]]:
    @functools.cache
    def ended(method: str) -> tuple[set[str], dict[str, bytes]]:
        deployment = Deployment(tmp_path_factory.mktemp(method), "run", method, keep_state=True)
        deployment.start()
        return deployment.complete()

    return ended


def test_a_robot_killed_while_leaving_whose_neighbour_has_ended_comes_back_to_the_same_end(
    tmp_path: Path, undisturbed: Any
) -> None:
    deployment = Deployment(tmp_path, "run", "fl", keep_state=True)
    one, two = deployment.lives["agent-1"], deployment.lives["agent-2"]
    presence, said = topics.presence(RUN, 1, 2), []

    def stop_at_the_end(topic: str) -> None:
        if said.count(presence) == 4:  # stages 0, 1 (twice, for its round 0) and 2 are out: nobody waits for it
            one._thread.join(DEADLINE_S)
            two._dead.set()
        said.append(topic)

    two.before = stop_at_the_end
    deployment.start()
    deployment.pump_until(lambda: two.has_ended, "robot 2's death")
    assert one.has_ended
    assert one.error is None
    two.kill()
    deployment.lives["agent-2"] = two.again()
    assert deployment.complete() == undisturbed("fl")
    assert deployment.retained == []


def test_a_data_center_killed_after_its_last_answer_when_all_robots_have_ended_comes_back_to_the_same_end(
    tmp_path: Path, undisturbed: Any
) -> None:
    deployment = Deployment(tmp_path, "run", "fedavg", keep_state=True)
    center, robots = deployment.lives["datacenter"], [deployment.lives[f"agent-{agent}"] for agent in (1, 2, 3, 4)]
    presence = topics.presence(RUN, 0, 0)

    def stop_at_the_end(topic: str) -> None:
        if topic == presence and all(deployment.recorder.stages.get(life.client, 0) >= 2 for life in robots):
            for life in robots:
                life._thread.join(DEADLINE_S)
            center._dead.set()

    center.before = stop_at_the_end
    deployment.start()
    deployment.pump_until(lambda: center.has_ended, "the data center's death")
    assert all(life.has_ended and life.error is None for life in robots)
    center.kill()
    deployment.lives["datacenter"] = center.again()
    assert deployment.complete() == undisturbed("fedavg")
    assert deployment.retained == []


@pytest.mark.parametrize("method", ["fl", "fomaml"])
def test_all_broken_off_with_one_cluster_done_is_started_again_and_recorded_whole(
    method: str, tmp_path: Path, undisturbed: Any
) -> None:
    first = Deployment(tmp_path, "first", method, keep_state=False)
    broken_off = threading.Event()
    first.lives["agent-3"].before = lambda topic: (broken_off.wait(DEADLINE_S), None)[1] if "/sl/" in topic else None
    first.start()
    done = {"agent-1", "agent-2"}
    first.pump_until(lambda: done.isdisjoint(first.recorder.waiting_for), "the end of cluster 1")
    assert {client: first.recorder.stages[client] for client in done} == dict.fromkeys(done, DONE)
    for life in first.lives.values():
        life._dead.set()
    broken_off.set()
    for life in first.lives.values():
        life.kill()

    second = Deployment(tmp_path, "second", method, keep_state=False, hub=first.hub)
    second.start()
    assert second.complete() == undisturbed(method)
    assert list((tmp_path / "state").iterdir()) == []  # nobody needs it any more
    assert second.retained == []


def test_who_is_done_stays_for_a_recorder_that_comes_anew(tmp_path: Path, undisturbed: Any) -> None:
    first = Deployment(tmp_path, "first", "fl", keep_state=False)
    first.start()
    first.pump_until(lambda: not first.recorder.waiting_for, "the end")
    gone = encode_json(Presence(agent=0, state="gone"))
    first.hub.connect("will").publish(topics.recorder(RUN), gone, retain=True)  # before it has said that it is over
    assert not any(life.has_ended for life in first.lives.values())

    second = Deployment(tmp_path, "second", "fl", keep_state=False, hub=first.hub)
    second.lives = first.lives
    assert second.complete() == undisturbed("fl")
    assert list((tmp_path / "state").iterdir()) == []


def test_who_comes_back_done_says_since_when(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    first = Deployment(tmp_path, "first", "fl", keep_state=True)
    first.start()
    first.complete()
    second = Deployment(tmp_path, "second", "fl", keep_state=True)
    second.start()
    rows, models = second.complete()
    assert (len(rows), len(models)) == (16, 2)  # round 0 and 3 rounds of 4 robots, handed in again
    assert "robot 1 of run r: done since 20" in caplog.text
    assert "to learn anew delete" in caplog.text


def test_who_comes_with_nothing_where_the_others_are_further_is_told_so(tmp_path: Path) -> None:
    deployment = Deployment(tmp_path, "run", "fl", keep_state=True)
    two = deployment.lives["agent-2"]
    robots = deployment.hub.connect("neighbour")
    robots.publish(topics.presence(RUN, 1, 1), encode_json(Presence(agent=1, stage=3, state="done")), retain=True)
    two.start()._thread.join(DEADLINE_S)
    assert two.has_ended
    assert "robot 1 is at stage 3 already, and robot 2 comes with stage 1: its state is lost" in str(two.error)
