"""Scenario files: what they resolve to, and one clear line for each thing that can be wrong."""

import math
import re
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.reading import load_scenario, scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import shipped_tensors
from jouleswarm.environments.landmarks.settings import Camera, World, task_map

SCENARIOS = Path(__file__).parents[2] / "scenarios"
MAP = "E*\n.X"


def two_tasks(**changes: Any) -> dict[str, Any]:
    tasks = [{"id": 1, "map": MAP}, {"id": 4, "map": MAP, "robots": 3}]
    meta = {"t0": 3, "training_tasks": [1]}
    return {"name": "two", "world": {"rows": 2, "cols": 2}, "tasks": tasks, "meta": meta, **changes}


def refused(data: dict[str, Any]) -> str:
    with pytest.raises(ConfigurationError) as caught:
        scenario_from(data, "two.toml")
    message = str(caught.value)
    assert message.startswith("scenario two.toml: ")
    assert "\n" not in message
    return message


@pytest.mark.parametrize("path", sorted(SCENARIOS.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_scenarios_are_valid_and_named_after_their_file(path: Path) -> None:
    assert load_scenario(path).name == path.stem


def test_paper_scenario_is_the_papers_deployment() -> None:
    paper = load_scenario(SCENARIOS / "paper.toml")
    assert paper.agents == tuple(range(1, 13))
    assert paper.meta.training_tasks == (1, 2, 6)
    assert paper.meta.t0 == 210
    assert {task.id: task_map(paper, task.id).exit for task in paper.tasks} == {
        1: (7, 0),
        2: (7, 1),
        3: (7, 2),
        4: (7, 3),
        5: (4, 4),
        6: (7, 4),
    }
    assert {task_map(paper, task.id).path[:3] for task in paper.tasks} == {((0, 2), (1, 2), (2, 2))}  # common stem
    frame_bytes = paper.spaces.observation.nbytes
    assert paper.learning.motions_per_round * frame_bytes == 24_576_000


def test_robots_are_numbered_in_the_order_of_the_tasks() -> None:
    scenario = scenario_from(two_tasks(), "two.toml")
    assert scenario.clusters == {1: (1, 2), 4: (3, 4, 5)}
    assert scenario.cluster(4) == (3, 4, 5)
    assert scenario.agents == (1, 2, 3, 4, 5)
    assert [scenario.task_of(agent) for agent in scenario.agents] == [1, 1, 4, 4, 4]
    assert scenario.training_agents == {1: (1,)}


def test_a_robot_that_is_not_there_is_named() -> None:
    with pytest.raises(ConfigurationError, match="robot 6 is not in the scenario"):
        scenario_from(two_tasks(), "two.toml").task_of(6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "a b"}, 'name: String should match pattern .*, got "a b"'),
        ({"sed": 1}, "sed: no such field; did you mean seed?"),
        ({"seed": -1}, "seed: .*greater than or equal to 0, got -1"),
        ({"tasks": []}, "tasks: .*at least 1 item"),
        ({"world": {"rows": 3, "cols": 2}}, r"task 1: map has 2 rows, expected 3 \(world.rows\)"),
        ({"tasks": [{"id": 1, "map": MAP}, {"id": 1, "map": MAP}]}, r"tasks have ids \[1, 1\]"),
        ({"tasks": [{"id": 1, "map": MAP, "rewards": [1, 2]}]}, "task 1: 2 rewards, expected 4"),
        ({"tasks": [{"id": 1}]}, "tasks.0.map: Field required"),
        ({"methods": []}, "methods: name each method once"),
        ({"methods": ["maml", "maml"]}, "methods: name each method once"),
        ({"methods": ["reptil"]}, "method 'reptil': expected anil, .* or module:name; did you mean reptile"),
        ({"meta": {"t0": 0, "training_tasks": [1]}}, "meta.t0 is 0, expected 1 or more"),
        ({"meta": {"training_tasks": [1, 2]}}, r"meta.training_tasks \(1, 2\) are not all among the tasks \[1, 4\]"),
        ({"meta": {"t0": 3, "snapshots": [2, 4], "training_tasks": [1]}}, "snapshots .* reach past meta.t0 = 3"),
        ({"meta": {"t0": 3, "adapt_from": [4], "training_tasks": [1]}}, "adapt_from .* reach past meta.t0 = 3"),
        ({"energy": {"robots_g_per_kwh": -1}}, "energy.robots_g_per_kwh: .*greater than or equal to 0, got -1"),
        ({"meta": {"training_tasks": [1], "robots_per_task": 3}}, "robots_per_task is 3, task 1 has 2"),
        ({"meta": {"training_tasks": [1], "rehearse_unseen": True}}, "there is no mean of other heads; expected"),
        (
            {"meta": {"rehearse_unseen": True, "heads": "shared"}},
            "rehearse_unseen with heads shared and training_tasks",
        ),
        ({"federation": {"topology": "random", "degree": 1}}, "task 4: no 1-regular graph of 3 robots exists"),
        ({"learning": {"epsilon": 1.5}}, "learning.epsilon: .*less than or equal to 1, got 1.5"),
        ({"camera": {"width": "wide"}}, 'camera.width: .*valid integer.*, got "wide"'),
        ({"meta": {"training_tasks": []}}, r"meta.training_tasks is empty and methods has maml: .*tasks \[1, 4\]"),
        ({"meta": {"training_tasks": [1, 1]}}, r"meta.training_tasks: got \[1, 1\], expected each once"),
        ({"meta": {"training_tasks": [1], "snapshots": [3, 3]}}, r"meta.snapshots: got \[3, 3\], expected each once"),
        ({"meta": {"training_tasks": [1], "adapt_from": [3, 3]}}, r"meta.adapt_from: got \[3, 3\], expected each once"),
        ({"energy": {"sl_bit_per_j": 1e-310}}, "energy.sl_bit_per_j: .*greater than or equal to 0.000001"),
        ({"federation": {"target_reward": 5e-324}}, "federation.target_reward: 4.94066e-324 is subnormal"),
        # pairs: each within its bounds
        (
            {"methods": ["fl", "anil"], "learning": {"motions_per_round": 1}},
            "learning.motions_per_round is 1 and methods has anil: .*expected 2 or more",
        ),
        (
            {"methods": ["centralized"], "world": {"rows": 2, "cols": 2, "max_motions": 1}},
            "world.max_motions is 1 and methods has centralized: .*expected 2 or more",
        ),
        ({"learning": {"replay_size": 2}}, "learning.replay_size: .*greater than or equal to 3"),
        ({"meta": {"training_tasks": [1], "support_newest": 2}}, "support_newest: .*greater than or equal to 3"),
        (
            {"methods": ["fl"], "federation": {"robots_per_cluster": 998}},
            "robots_per_cluster 998 come to 1001 robots, expected 1000 at most",
        ),
        (
            {
                "methods": ["fl"],
                "federation": {"topology": "random", "degree": 1, "robots_per_cluster": 4},
                "tasks": [{"id": 1, "map": MAP}],
            },
            "federation.degree 1 joins robots in pairs only, and task 1 has 4",
        ),
        ({"network": {"width": 7}}, r"network.conv \[\[32, 8, 4\].*leaves nothing of .* 7 x 72"),
        ({"network": {"width": 1024, "height": 1024}}, r"conv and dense come to \d+ parameters, expected 60000000"),
        # 2 x 2 landmarks: 100 000 motions of at most |80| + nothing else larger: 8e6 is fine, of 1e6 it is 1e11
        (
            {"world": {"rows": 2, "cols": 2, "max_motions": 100_000, "exit_reward": 1e6}},
            r"world.max_motions 100000 at rewards of up to 1e\+06 \(task 1\) add up to 1e\+11, expected 1e\+09",
        ),
        # 96 x 72 x 4 bytes x 10^7 = 257 GiB
        ({"learning": {"replay_size": 10_000_000}}, "learning.replay_size x .* come to 257 GiB .*expected 64 GiB"),
        ({"meta": {"training_tasks": [1], "replay_size": 10_000_000}}, "meta.replay_size x .* come to 257 GiB"),
        (
            {"learning": {"batches_per_round": 1000, "batch_size": 1000}},
            "learning.batches_per_round x learning.batch_size x .* come to 257 GiB",
        ),
        (
            {"world": {"rows": 2, "cols": 2, "cell_m": 0.05}},
            "camera.pose_jitter_m 0.03 is more than half of world.cell_m 0.05",
        ),
    ],
)
def test_what_is_wrong_is_said_in_one_line(changes: dict[str, Any], message: str) -> None:
    assert re.search(message, refused(two_tasks(**changes)))


def test_without_meta_learning_the_meta_section_does_not_matter() -> None:
    scenario = scenario_from(two_tasks(methods=["fl"], meta={"t0": 0, "training_tasks": [9]}), "x")
    assert scenario.arms == (Arm("fl", "fl", 0),)


def test_each_meta_learning_method_has_an_arm_for_every_model_that_is_adapted() -> None:
    meta = {"t0": 3, "training_tasks": [1], "adapt_from": [2, 1, 3]}
    scenario = scenario_from(two_tasks(methods=["reptile", "fedavg", "maml"], meta=meta), "x")
    assert scenario.arm_names == ("reptile-t1", "reptile-t2", "reptile", "fedavg", "maml-t1", "maml-t2", "maml")
    assert [arm.t0 for arm in scenario.arms] == [1, 2, 3, 0, 1, 2, 3]
    assert scenario.meta_methods == ("reptile", "maml")


@pytest.mark.parametrize(
    ("methods", "needed"), [(["fl", "isolated"], False), (["fl", "fedavg"], True), (["anil"], True)]
)
def test_the_data_center_is_needed_by_methods_that_use_it(methods: list[str], needed: bool) -> None:
    assert scenario_from(two_tasks(methods=methods), "x").needs_datacenter is needed


def numbers(model: type[BaseModel], where: str = "") -> list[str]:
    """Every number of a scenario, as section.key."""
    found = []
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found += numbers(kind, f"{where}{name}.")
        elif re.search(r"\b(int|float)\b", str(kind)) and "tuple" not in str(kind) and "Literal[0, 1]" not in str(kind):
            found.append(where + name)
    return found


@pytest.mark.parametrize("key", [*numbers(Scenario), *numbers(World, "world."), *numbers(Camera, "camera.")])
@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan, 1e300, -1e300, 10**21, 5e-324])
def test_every_number_is_finite_bounded_and_no_subnormal(key: str, value: float) -> None:
    data = two_tasks()
    *sections, last = key.split(".")
    place = data
    for section in sections:
        place = place.setdefault(section, {})
    place[last] = value
    assert key in refused(data)


def test_what_does_not_fit_together_without_it_may_be_there() -> None:
    """FL sees the frame after each motion at once, and nothing is drawn in the data center."""
    scenario = scenario_from(
        two_tasks(methods=["fl"], learning={"motions_per_round": 1}, meta={"training_tasks": []}), "x"
    )
    assert scenario.learning.motions_per_round == 1


def test_parameters_are_counted_as_the_network_has_them() -> None:
    for name, parameters in (
        ("paper", 1_391_268),
        ("toy", 9_532),
    ):  # toy: 8 (4x16+1) + 16 (8x9+1) + 32 (240+1) + 4 x 33
        scenario = load_scenario(SCENARIOS / f"{name}.toml")
        interface = shipped_tensors(scenario.network, scenario.spaces)
        assert interface is not None
        assert sum(interface.entries) == parameters


def write(folder: Path, text: str) -> Path:
    path = folder / "s.toml"
    path.write_text(text, encoding="utf-8")
    return path


ONE_TASK = f"""
name = "s"
methods=["fl"]
world = {{ rows = 2, cols = 2 }}
tasks = [{{ id = 1, map = '''
{MAP}
''' }}]
"""


def test_overrides_are_toml_values_or_plain_text(tmp_path: Path) -> None:
    scenario: Scenario = load_scenario(
        write(tmp_path, ONE_TASK), ["seed=7", "meta.snapshots=[2]", "federation.topology=ring", "world.cell_m=0.5"]
    )
    assert (scenario.seed, scenario.meta.snapshots) == (7, (2,))
    assert (scenario.federation.topology, scenario.world.cell_m) == ("ring", 0.5)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("meta.t0", "override 'meta.t0': expected section.key=value"),
        ("=3", "override '=3': expected section.key=value"),
        ("name.first=3", "override 'name.first=3': 'name' is not a section"),
        ("meta.t9=3", "meta.t9: no such field; did you mean meta.t0?"),
    ],
)
def test_a_bad_override_is_explained(tmp_path: Path, override: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        load_scenario(write(tmp_path, ONE_TASK), [override])


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"none\.toml: cannot be read \(No such file"):
        load_scenario(tmp_path / "none.toml")


@pytest.mark.parametrize("content", [b"name = ", b"\xff\xfe"])
def test_a_file_that_is_not_toml_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigurationError, match=r"bad\.toml: not valid TOML"):
        load_scenario(path)
