"""Robots that do not do the same: motions and batches of their own, several that train the meta-model; by hand."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from jouleswarm.agents.robot import run_agent
from jouleswarm.codecs.floats import FLOAT32
from jouleswarm.codecs.models import read_model
from jouleswarm.common.bus.bus import MemoryBus, MemoryHub
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.documents import parse_toml
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.datacenter.center import run_datacenter
from jouleswarm.energy.facts import Counts
from jouleswarm.learning.networks import build_qnetwork, shapes_of
from jouleswarm.methods.method import Method, Update
from jouleswarm.runs.lost_work import lost_work
from jouleswarm.runs.sizes import expected_counts, scenario_sizes
from jouleswarm.simulation import run_in_memory

TOY = parse_toml((Path(__file__).parents[2] / "scenarios" / "toy.toml").read_text())
DEADLINE_S = 60.0
SETTINGS = {
    "federation": {"max_rounds": 2, "target_reward": 1000, "robots_per_cluster": 3},
    "learning": {"motions_per_round": 6, "batches_per_round": 4},
    "meta": {
        "t0": 2,
        "training_tasks": [1, 2],
        "robots_per_task": 2,
        "support_batches": 4,
        "query_batches": 2,
        "inner_steps": 2,
    },
}
ROBOTS = [{"id": 2, "motions_per_round": 12}, {"id": 3, "motions_per_round": 2, "batches_per_round": 1}]
TASKS = [TOY["tasks"][0], {**TOY["tasks"][1], "motions_per_round": 3, "batches_per_round": 5}]
MOTIONS, BATCHES = {1: 6, 2: 12, 3: 2, 4: 3, 5: 3, 6: 3}, {1: 4, 2: 4, 3: 1, 4: 5, 5: 5, 6: 5}
Model = Mapping[str, npt.NDArray[np.float32]]


def unequal(*methods: str, **changes: object) -> Scenario:
    sections = {name: {**TOY.get(name, {}), **values} for name, values in SETTINGS.items()}
    return scenario_from({**TOY, **sections, "tasks": TASKS, "robots": ROBOTS, "methods": methods, **changes}, "test")


def test_a_robot_s_own_setting_comes_before_its_task_s_and_that_before_all_others() -> None:
    scenario = unequal("fl")
    assert {agent: scenario.motions(agent) for agent in scenario.agents} == MOTIONS
    assert {agent: scenario.batches(agent) for agent in scenario.agents} == BATCHES


@pytest.mark.parametrize("robots", [[{"id": 7, "motions_per_round": 2}], [{"id": 2}, {"id": 2}]])
def test_robots_that_there_are_not_or_twice_are_refused(robots: list[dict[str, int]]) -> None:
    with pytest.raises(ConfigurationError, match=r"robots have ids .*, expected each once and of those"):
        unequal("fl", robots=robots)


def test_unequal_robots_are_mixed_by_how_much_is_new_at_each() -> None:
    fl: Method = unequal("fl").method("fl")
    theirs = {agent: Update({"w": np.array([w], np.float32)}, MOTIONS[agent], 1) for agent, w in ((2, 8.0), (3, 1.0))}
    # sigma_12 = 12 / 14, sigma_13 = 2 / 14: 4 + 1/3 x (12/14 x (8 - 4) + 2/14 x (1 - 4)) = 4 + 1/3 x 3
    assert fl.mix({"w": np.array([4.0], np.float32)}, theirs, 1 / 3)["w"] == pytest.approx(5.0)


def told(bus: MemoryBus, scenario: Scenario) -> dict[tuple[int, int], tuple[Model, ModelHeader]]:
    """(round, agent) -> what was said of it."""
    shapes, found = shapes_of(build_qnetwork(scenario)), {}
    while message := bus.receive(0.001):
        model, header = read_model(message.payload, shapes, FLOAT32)
        found[header.round, header.agent] = model, header
    return found


def heard(scenario: Scenario, *filters: str) -> dict[tuple[int, int], tuple[Model, ModelHeader]]:
    """What was said on some topics in a whole run."""
    hub = MemoryHub()
    ears = hub.connect("ears")
    ears.subscribe(*filters)

    def body(agent: int) -> None:
        use_one_thread()
        bus = hub.connect(f"agent-{agent}" if agent else "datacenter")
        run_agent(scenario, agent, "r", bus) if agent else run_datacenter(scenario, "r", bus)

    agents = (*scenario.agents, *((0,) if scenario.needs_datacenter else ()))
    threads = [threading.Thread(target=body, args=(agent,), daemon=True) for agent in agents]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(DEADLINE_S)
        assert not thread.is_alive()
    return told(ears, scenario)


def test_the_data_center_averages_unequal_robots_by_what_they_say_is_new() -> None:
    scenario = unequal("fedavg")
    up, down = topics.weights_up("r", "fedavg", 1, "+"), topics.cluster_model("r", "fedavg", 1)
    said = heard(scenario, up, down)
    assert {agent: said[1, agent][1].samples for agent in (0, 1, 2, 3)} == {0: 20, 1: 6, 2: 12, 3: 2}
    models = {agent: said[1, agent][0] for agent in (0, 1, 2, 3)}
    for name, average in models[0].items():
        expected = 6 / 20 * models[1][name] + 12 / 20 * models[2][name] + 2 / 20 * models[3][name]
        np.testing.assert_allclose(average, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("method", ["fl", "fedavg", "centralized", "isolated"])
def test_each_computes_and_moves_as_much_as_it_is_set_to_and_the_closed_form_says_so(method: str) -> None:
    scenario = unequal(method)
    outcome, rounds = run_in_memory(scenario), {1: 2, 2: 2}
    computed = {agent: sum(row.gradients for row in outcome.rows if row.agent == agent) for agent in scenario.agents}
    center = {task: sum(row.gradients for row in outcome.rows if (row.agent, row.task) == (0, task)) for task in (1, 2)}
    counts = expected_counts(scenario, method, 0, rounds, scenario_sizes(scenario)).fl
    if method == "centralized":
        assert center == {1: 2 * (4 + 4 + 1), 2: 2 * 15}
        assert counts.gradients_support == 48
        assert counts.uplink_bytes == 2 * (6 + 12 + 2 + 9) * 64 * 48 * 4
    else:
        assert computed == {agent: 2 * batches for agent, batches in BATCHES.items()}
        assert counts.gradients_robots == 48
    assert counts.gradients_support + counts.gradients_robots == sum(row.gradients for row in outcome.rows)


@pytest.mark.parametrize(
    ("method", "query"), [("maml", True), ("anil", True), ("reptile", False), ("multitask", False)]
)
def test_a_stage_takes_gradients_on_the_data_of_every_robot_that_trains(method: str, query: bool) -> None:
    scenario = unequal(method)
    outcome = run_in_memory(scenario)
    stage = [row for row in outcome.rows if row.agent == 0]
    # 2 rounds x 2 tasks x 2 robots x (4 + 2) batches: eq. (9), sum over i and k
    told = (sum(row.gradients_support or 0 for row in stage), sum(row.gradients_query or 0 for row in stage))
    assert told == ((32, 16) if method in ("maml", "anil") else (48, 0))
    expected = expected_counts(scenario, method, 2, {1: 2, 2: 2}, scenario_sizes(scenario)).ml
    assert (expected.gradients_support, expected.gradients_query) == told
    # robots 1 and 2 of task 1, 4 and 5 of task 2: 6 + 12 + 3 + 3 motions of 64 x 48 x 4 bytes a round
    assert expected.uplink_bytes == 2 * 24 * 64 * 48 * 4
    assert lost_work(scenario, outcome.rows, outcome.hub.meter.work("datacenter")) == []
    assert isinstance(expected, Counts)
