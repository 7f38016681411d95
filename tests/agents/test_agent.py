"""Whole runs of all robots and the data center in one process, over the in-memory bus."""

import contextlib
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy

from jouleswarm.agents.robot import run_agent
from jouleswarm.codecs.floats import FLOAT32
from jouleswarm.codecs.models import read_model
from jouleswarm.common.bus.bus import MemoryBus, MemoryHub
from jouleswarm.common.disk.state import Keep
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import ModelHeader, MotionHeader, Presence, encode_json
from jouleswarm.common.wire.models import encode_model
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.datacenter.center import run_datacenter
from jouleswarm.learning.heads import head_of, meta_shapes
from jouleswarm.learning.networks import build_qnetwork, shapes_of, to_weights
from jouleswarm.runs.traffic import traffic
from jouleswarm.simulation import Outcome, run_in_memory
from tests.made_up import encode_motion

TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"
DEADLINE_S = 60.0
ROUNDS, T0, MOTIONS, BATCHES = 3, 2, 6, 4
# No robot can reach a target of 1000: every arm lasts ROUNDS rounds.
SMALL = [
    f"federation.max_rounds={ROUNDS}", "federation.target_reward=1000", f"meta.t0={T0}",
    f"learning.motions_per_round={MOTIONS}", f"learning.batches_per_round={BATCHES}",
]  # fmt: skip


def small(*overrides: str) -> Scenario:
    return load_scenario(TOY, [*SMALL, *overrides])


def figures(rows: list[RoundRow]) -> list[dict[str, Any]]:
    return [row.model_dump(exclude={"seconds"}) for row in rows]


def model_bytes(scenario: Scenario) -> int:
    """Payload of a robot's weights: as long in every round."""
    cluster = len(scenario.cluster(1))
    header = ModelHeader(
        task=1, agent=1, round=1, reward=1.0, samples=1, rewards=dict.fromkeys(range(cluster), (1, 1.0))
    )
    return len(encode_model(to_weights(build_qnetwork(scenario)), header))


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run_in_memory(small())


def test_the_same_scenario_twice_gives_the_same_figures_and_the_same_bits(outcome: Outcome) -> None:
    again = run_in_memory(small())
    assert figures(again.rows) == figures(outcome.rows)
    assert again.learned == outcome.learned
    assert again.snapshots == outcome.snapshots


def test_another_seed_gives_other_weights(outcome: Outcome) -> None:
    other = run_in_memory(small("seed=2"))
    assert all(other.learned[key] != weights for key, weights in outcome.learned.items())


def test_there_is_a_row_for_each_robot_and_round(outcome: Outcome) -> None:
    counted = Counter((row.phase, row.arm, row.task, row.agent) for row in outcome.rows)
    expected: dict[Any, int] = {("maml", "maml", 1, 0): T0, ("maml", "maml", 1, 1): T0}  # task 1 trains, robot 1 sends
    for arm in ("maml", "fl"):
        expected |= {("fl", arm, task, agent): ROUNDS + 1 for task, agent in ((1, 1), (1, 2), (2, 3), (2, 4))}
    assert counted == expected
    assert {row.learned for row in outcome.rows if row.phase == "fl" and row.round == ROUNDS} == {False}
    assert {row.learned for row in outcome.rows if row.round < ROUNDS} == {None}


def test_gradients_are_those_computed(outcome: Outcome) -> None:
    told = {(row.phase, row.agent != 0): row.gradients for row in outcome.rows}
    # data center: 4 support and 4 query batches of the toy scenario; collecting for it takes none
    assert told == {("maml", False): 8, ("maml", True): 0, ("fl", True): BATCHES}
    assert {(row.gradients_support, row.gradients_query) for row in outcome.rows if row.agent == 0} == {(4, 4)}


def test_all_robots_of_a_cluster_know_the_same_reward(outcome: Outcome) -> None:
    known: dict[Any, set[float | None]] = {}
    for row in outcome.rows:
        if row.phase == "fl":
            known.setdefault((row.arm, row.task, row.round), set()).add(row.cluster_reward)
    assert all(len(rewards) == 1 for rewards in known.values())


def test_the_clusters_reward_is_the_windowed_mean_of_its_robots_rewards(outcome: Outcome) -> None:
    rewards = {(row.agent, row.round): row.reward for row in outcome.rows if (row.phase, row.arm) == ("fl", "maml")}
    (last,) = {row.cluster_reward for row in outcome.rows if (row.arm, row.task, row.round) == ("maml", 2, 3)}
    window = [rewards[agent, round_] for agent in (3, 4) for round_ in (2, 3)]  # the toy's window is 2 rounds
    assert last == pytest.approx(sum(window) / 4)


def test_learned_weights_are_safetensors_of_the_last_round(outcome: Outcome) -> None:
    assert set(outcome.learned) == {("maml", 1), ("maml", 2), ("fl", 1), ("fl", 2)}
    shapes = {name: tensor.shape for name, tensor in to_weights(build_qnetwork(small())).items()}
    for payload in outcome.learned.values():
        tensors = safetensors.numpy.load(payload)
        assert {name: tensor.shape for name, tensor in tensors.items()} == shapes
        assert all(np.isfinite(tensor).all() for tensor in tensors.values())
    assert set(outcome.snapshots) == {("maml", T0)}


def sidelink(outcome: Outcome, arm: str) -> tuple[int, int]:
    counted = traffic(outcome.hub.meter.rows(), arm, topics.Link.SIDELINK)
    return counted.messages, counted.payload


@pytest.mark.parametrize(
    ("overrides", "links"),
    [  # directed links of a cluster; the toy scenario has two clusters
        ([], 2),
        (["bus.qos=0"], 2),
        (["federation.robots_per_cluster=1"], 0),
        (["federation.robots_per_cluster=3"], 6),
        (["federation.robots_per_cluster=4", "federation.topology=ring"], 8),
        (["federation.robots_per_cluster=4", "federation.topology=random", "federation.degree=3"], 12),
        (["federation.step=1.0"], 2),
    ],
)
def test_every_shape_of_cluster_completes_and_moves_rounds_x_links_x_payload(overrides: list[str], links: int) -> None:
    scenario = small(*overrides)
    outcome = run_in_memory(scenario)
    assert len({row.agent for row in outcome.rows if row.agent}) == len(scenario.agents)
    for arm in ("maml", "fl"):
        messages = 2 * ROUNDS * links
        assert sidelink(outcome, arm) == (messages, messages * model_bytes(scenario))
    assert set(outcome.learned) == {(arm, task) for arm in ("maml", "fl") for task in (1, 2)}


def meta_model_shapes(scenario: Scenario) -> dict[str, tuple[int, ...]]:
    network = build_qnetwork(scenario)
    return meta_shapes(shapes_of(network), head_of(network), scenario.meta.training_tasks)


def test_uplink_and_downlink_move_what_the_equations_count(outcome: Outcome) -> None:
    scenario, rows = small(), outcome.hub.meter.rows()
    frame = np.zeros((48, 64, 4), np.uint8)
    header = MotionHeader(task=1, agent=1, round=1, motion=0, action=0, reward=0, first=True, terminated=False)
    motion_bytes = len(encode_motion(frame, header))
    assert traffic(rows, "maml", topics.Link.UPLINK)[:2] == (T0 * MOTIONS, T0 * MOTIONS * motion_bytes)
    model = {name: np.zeros(shape, np.float32) for name, shape in meta_model_shapes(scenario).items()}
    meta_bytes = len(encode_model(model, ModelHeader(task=0, agent=0, round=T0)))
    assert traffic(rows, "maml", topics.Link.DOWNLINK)[:2] == (4, 4 * meta_bytes)
    for link in (topics.Link.UPLINK, topics.Link.DOWNLINK):
        assert traffic(rows, "fl", link).messages == 0


def test_a_task_that_is_learned_ends_early_and_says_so() -> None:
    # A target that any cluster reaches before its first round.
    outcome = run_in_memory(small("federation.target_reward=-1e9", "methods=['fl']"))
    ends = {(row.task, row.agent): (row.round, row.learned) for row in outcome.rows}
    assert ends == {(1, 1): (0, True), (1, 2): (0, True), (2, 3): (0, True), (2, 4): (0, True)}


@pytest.mark.parametrize("arms", ["['maml']", "['fl']", "['fl', 'maml']"])
def test_any_choice_of_arms_completes_and_an_arm_does_not_depend_on_the_other(outcome: Outcome, arms: str) -> None:
    scenario = small(f"methods={arms}")
    alone = run_in_memory(scenario)
    assert {key: outcome.learned[key] for key in alone.learned} == alone.learned
    assert {arm for arm, _ in alone.learned} == set(scenario.arm_names)


@pytest.mark.parametrize(
    ("overrides", "offsets", "moved"),
    [
        ([], {2: 1.0}, 0.5),  # half way to the one neighbour
        (["federation.step=1.0"], {2: 1.0}, 1.0),  # the literal equation takes its model over
        # 1/3 of the way to the mean by samples (see below): (10 x 1 + 30 x 3) / 40 = 2.5
        (["federation.robots_per_cluster=3"], {2: 1.0, 3: 3.0}, 2.5 / 3),
    ],
)
def test_a_robot_moves_to_its_neighbours_by_equation_6(
    overrides: list[str], offsets: dict[int, float], moved: float
) -> None:
    # Robot 1 learns nothing of its own; its neighbours are played here.
    still = ["methods=['fl']", "federation.max_rounds=2", "learning.optimizer=sgd", "learning.lr=1e-30"]
    scenario, hub = small(*still, *overrides), MemoryHub()
    hands = hub.connect("hands")
    hands.subscribe(topics.weights("r", "fl", 1, 1))
    for agent in offsets:
        here = Presence(agent=agent, stage=1, rewards={agent: 0.0})  # of round 0
        hands.publish(topics.presence("r", 1, agent), encode_json(here), retain=True)
    robot = in_thread(run_agent, scenario, 1, "r", hub.connect("agent-1"))
    shapes = shapes_of(build_qnetwork(scenario))
    published = []
    for round_ in (1, 2):
        message = hands.receive(DEADLINE_S)
        assert message is not None
        weights, header = read_model(message.payload, shapes, FLOAT32)
        assert (header.agent, header.round, header.samples) == (1, round_, MOTIONS)
        published.append(weights)
        for agent, offset in offsets.items():
            theirs = ModelHeader(
                task=1, agent=agent, round=round_, reward=0.0, samples=10 if agent == 2 else 30,
                rewards={agent: (round_, 0.0)},
            )  # fmt: skip
            payload = encode_model({name: tensor + np.float32(offset) for name, tensor in weights.items()}, theirs)
            hands.publish(topics.weights("r", "fl", 1, agent), payload)
    for agent in offsets:  # done: nobody needs robot 1 any more
        hands.publish(topics.presence("r", 1, agent), encode_json(Presence(agent=agent, stage=3)), retain=True)
    assert ended(robot)
    for name, before in published[0].items():
        np.testing.assert_allclose(published[1][name] - before, moved, rtol=0, atol=1e-6)


def test_the_meta_model_is_where_federated_learning_starts() -> None:
    still = ["methods=['maml']", "federation.max_rounds=1", "learning.optimizer=sgd", "learning.lr=1e-30"]
    scenario, hub = small(*still), MemoryHub()
    ears = hub.connect("ears")
    ears.subscribe(topics.snapshot("r", "maml", "+"), topics.weights("r", "maml", 1, 1))
    threads = [in_thread(run_agent, scenario, agent, "r", hub.connect(f"agent-{agent}")) for agent in scenario.agents]
    threads.append(in_thread(run_datacenter, scenario, "r", hub.connect("datacenter")))
    assert all(ended(thread) for thread in threads)
    snapshot, weights = ears.receive(0), ears.receive(0)
    assert snapshot is not None
    assert weights is not None
    meta = safetensors.numpy.load(bytes(snapshot.payload))
    assert {name: tensor.shape for name, tensor in meta.items()} == meta_model_shapes(scenario)
    first, _ = read_model(weights.payload, shapes_of(build_qnetwork(scenario)), FLOAT32)
    # Robot 1's task is trained on, so its last layer is the task's own.
    for name, tensor in first.items():
        assert np.array_equal(tensor, meta.get(f"task1/{name}", meta[name]))
    assert "task1/7.weight" in meta


def dying(bus: MemoryBus) -> MemoryBus:
    """Ends its process, so to speak, in the last round, when the meta-model is to be handed in."""
    publish = bus.publish

    def publish_or_die(topic: str, payload: bytes, **options: Any) -> None:
        if topic.endswith("/snapshot"):
            raise ConnectionAbortedError("the data center dies")
        publish(topic, payload, **options)

    bus.publish = publish_or_die  # type: ignore[method-assign]
    return bus


def in_thread(body: Callable[..., None], *arguments: Any) -> threading.Thread:
    """A process, so to speak."""

    def one_process() -> None:
        use_one_thread()
        with contextlib.suppress(ConnectionAbortedError):
            body(*arguments)

    thread = threading.Thread(target=one_process, daemon=True)
    thread.start()
    return thread


def ended(thread: threading.Thread) -> bool:
    thread.join(DEADLINE_S)
    return not thread.is_alive()


def test_a_data_center_that_died_goes_on_from_its_checkpoint_to_the_same_end(outcome: Outcome, tmp_path: Path) -> None:
    scenario = small("bus.resend_after_s=0.05")
    hub = MemoryHub()
    recorder = hub.connect("recorder")
    recorder.subscribe(topics.snapshot("r", "+", "+"))
    robots = [in_thread(run_agent, scenario, agent, "r", hub.connect(f"agent-{agent}")) for agent in scenario.agents]
    assert ended(in_thread(run_datacenter, scenario, "r", dying(hub.connect("datacenter")), Keep(tmp_path)))
    assert (tmp_path / "maml" / "state.0").exists()
    assert recorder.receive(0.001) is None
    recorder.publish(topics.presence("r", 0, 0), encode_json(Presence(agent=0, state="gone")), retain=True)  # its will

    assert ended(in_thread(run_datacenter, scenario, "r", hub.connect("datacenter"), Keep(tmp_path)))
    assert all(ended(robot) for robot in robots)
    message = recorder.receive(0)
    assert message is not None
    assert message.payload == outcome.snapshots["maml", T0]
    assert not tmp_path.exists()
