"""A finished run goes on with more rounds, in memory: to what it would have come to with as many from the beginning."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from jouleswarm.agents.robot import run_agent
from jouleswarm.common.bus.bus import MemoryBus, MemoryHub
from jouleswarm.common.bus.reporter import Telemetry
from jouleswarm.common.disk.state import Keep
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import decode_json
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.datacenter.center import run_datacenter
from jouleswarm.simulation import run_in_memory

TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"  # 2 tasks, 2 robots each
DEADLINE_S = 100.0
SMALL = ("meta.t0=2", "learning.motions_per_round=6", "learning.batches_per_round=4", "federation.reward_window=1")
Rows = dict[tuple[object, ...], str]


def told(row: RoundRow) -> str:
    return row.model_dump_json(exclude={"seconds", "refused"})


class Run:
    """Its processes as threads, each with a folder that stays."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rows: Rows = {}
        """As each was told last."""
        self.models: dict[str, bytes] = {}
        self.told = 0

    def go(self, scenario: Scenario) -> None:
        hub, errors = MemoryHub(), list[BaseException]()
        recorder = hub.connect("recorder")
        recorder.subscribe(topics.telemetry("r", "+", "+"), topics.learned("r", "+", "+"))

        def process(client: str, body: Callable[[MemoryBus, Keep], None]) -> None:
            use_one_thread()
            bus = hub.connect(client)
            bus.meter = Meter("client", self.folder / client)
            try:
                body(bus, Keep(self.folder / client, at_the_end=True, ends=True))
            except BaseException as error:
                errors.append(error)
                raise

        bodies = {f"agent-{agent}": functools.partial(run_agent, scenario, agent, "r") for agent in scenario.agents}
        if scenario.needs_datacenter:
            bodies["datacenter"] = functools.partial(run_datacenter, scenario, "r")
        threads = [threading.Thread(target=process, args=each, daemon=True) for each in bodies.items()]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(DEADLINE_S)
            assert errors == []
            assert not thread.is_alive()
        while message := recorder.receive(0.001):
            if message.topic.endswith("/round"):
                row = decode_json(message.payload, Telemetry).row
                self.rows[row.sort_key()] = told(row)
                self.told += 1
            else:
                self.models[message.topic] = bytes(message.payload)


def scenario(methods: str, rounds: int, *more: str) -> Scenario:
    limits = (f"federation.max_rounds={rounds}", "federation.target_reward=1000")
    return load_scenario(TOY, [*SMALL, f"methods={methods}", *limits, *more])


@pytest.mark.parametrize(
    ("methods", "more"),
    [
        ("['maml', 'fl']", ("federation.codec=topk",)),
        ("['isolated', 'multitask']", ()),
        ("['fedavg', 'centralized']", ("federation.codec=topk",)),
        ("['fl', 'fedavg']", ("federation.robots_per_cluster=3", "federation.topology=ring")),
    ],
)
def test_more_rounds_come_to_what_as_many_from_the_beginning_come_to(
    methods: str, more: tuple[str, ...], tmp_path: Path
) -> None:
    run, undisturbed = Run(tmp_path), run_in_memory(scenario(methods, 5, *more))
    run.go(scenario(methods, 2, *more))
    told_before = run.told
    for rounds in (3, 5):  # and once more
        run.go(scenario(methods, rounds, *more))
    assert run.rows == {row.sort_key(): told(row) for row in undisturbed.rows}
    learned = {topics.learned("r", arm, task): model for (arm, task), model in undisturbed.learned.items()}
    assert run.models == learned
    again = len(undisturbed.rows) - told_before
    # each robot tells the last row of each arm anew, both times: it is not the last one any more
    robots_and_arms = sum(row.agent != 0 and row.phase == "fl" and row.round == 5 for row in undisturbed.rows)
    assert run.told - told_before == again + 2 * robots_and_arms


def test_a_cluster_that_has_learned_does_not_go_on_and_a_higher_target_lets_it(tmp_path: Path) -> None:
    run = Run(tmp_path)

    def settings(target: float) -> Scenario:
        return scenario("['fl']", 4, f"federation.target_reward={target}")

    run.go(settings(-1000))  # reached before the first round, whatever the reward
    assert {key[-1] for key in run.rows} == {0}
    before = run.told
    run.go(settings(-1000))
    assert run.told == before
    run.go(settings(1000))
    undisturbed = run_in_memory(settings(1000))
    assert run.rows == {row.sort_key(): told(row) for row in undisturbed.rows}
