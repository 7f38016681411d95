"""Environments and networks that come in by the doors, from start to bill: what is learned, sent, kept and priced."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import safetensors.numpy

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.saved_models import check_model
from jouleswarm.learning.networks import build_qnetwork, load_weights
from jouleswarm.runs.interface import interface_of
from jouleswarm.runs.run import load_run
from jouleswarm.simulation import Outcome, run_in_memory

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
BRIEF = (
    'methods=["maml","fl","centralized"]', "federation.max_rounds=2", "federation.target_reward=1e6",
    "federation.robots_per_cluster=2", "meta.t0=2", "meta.snapshots=[2]", "meta.batch_size=4", "learning.batch_size=4",
    "learning.motions_per_round=8", "learning.batches_per_round=2",
)  # fmt: skip
HAS_MINIGRID = importlib.util.find_spec("minigrid") is not None
# Scenario -> bytes of an observation: Discrete (int64), float32 [4], uint8 [28, 28, 3], float32 [7], uint8 [48, 64, 4].
WORLDS = {"frozenlake": 8, "cartpole": 16, "minigrid": 28 * 28 * 3, "examples/corridor.toml": 28, "toy": 12_288}


def brief(name: str, *overrides: str) -> Scenario:
    return load_scenario(ROOT / name if name.endswith(".toml") else name, [*BRIEF, *overrides])


@pytest.mark.parametrize("name", WORLDS)
def test_every_way_to_learn_works_in_every_environment(name: str) -> None:
    if name == "minigrid" and not HAS_MINIGRID:
        pytest.skip("needs jouleswarm[minigrid]")
    scenario = brief(name)
    outcome = run_in_memory(scenario)
    robots, training = len(scenario.agents), len(scenario.meta.training_tasks)
    rows = {arm: [row for row in outcome.rows if row.arm == arm and row.phase == "fl"] for arm in scenario.arm_names}
    for arm in ("maml", "fl", "centralized"):
        of_robots = [row for row in rows[arm] if row.agent]
        assert len(of_robots) == 3 * robots  # round 0, and two more
        assert all(row.reward is not None and row.refused == 0 for row in of_robots)
        assert (arm, scenario.tasks[0].id) in outcome.learned
    gradients = {arm: sum(row.gradients for row in rows[arm]) for arm in rows}
    assert gradients == dict.fromkeys(rows, 2 * robots * 2)  # rounds x robots x batches, wherever they are computed
    moved = [row for row in outcome.rows if row.phase == "maml" and row.agent == 0]
    assert len(moved) == 2 * training
    header = {(row.experience_bytes or 0) - 8 * WORLDS[name] for row in moved}
    assert all(8 * 300 < each < 8 * 600 for each in header)  # 8 messages: the array's own bytes, and a header each
    assert scenario.spaces.observation.nbytes == WORLDS[name]


def plays(scenario: Scenario, outcome: Outcome, arm: str) -> None:
    """A saved model fits the network, and says all that it is fed with."""
    payload = outcome.learned[arm, scenario.tasks[0].id]
    told, model = check_model(payload), build_qnetwork(scenario)
    load_weights(model, safetensors.numpy.load(payload))
    assert told.input is not None
    assert told.input.observation == scenario.spaces.observation
    assert told.input.shape == model.takes.fed
    assert told.actions == scenario.spaces.actions
    fed = model.prepare(np.zeros((1, *model.takes.shape), model.takes.dtype))
    assert fed.shape == (1, *told.input.shape)
    assert model(fed).shape == (1, len(told.actions))


@pytest.mark.parametrize(
    ("name", "layout", "actions"),
    [("frozenlake", "one-hot", ("0", "1", "2", "3")), ("cartpole", "flat", ("left", "right"))],
)
def test_a_saved_model_says_what_it_is_fed_with(name: str, layout: str, actions: tuple[str, ...]) -> None:
    scenario = brief(name, 'methods=["fl"]', "federation.max_rounds=1")
    outcome = run_in_memory(scenario)
    plays(scenario, outcome, "fl")
    told = check_model(outcome.learned["fl", 1])
    assert told.input is not None
    assert told.evaluation is not None
    assert (told.input.layout, told.input.height, told.actions) == (layout, None, actions)
    # A lake cannot go on: its episodes are begun by seeds. A pole can, and its generator's state is told.
    assert (told.evaluation.seed is None, told.evaluation.noise is None) == (
        (True, False) if layout == "flat" else (False, True)
    )


def test_the_same_seed_is_the_same_run_to_the_bit() -> None:
    rows = []
    for _ in range(2):
        outcome = run_in_memory(brief("frozenlake", 'methods=["maml","centralized"]'))
        rows.append([row.model_copy(update={"seconds": 0.0}) for row in outcome.rows])
    assert rows[0] == rows[1]


def test_a_corridor_is_learned_with_a_network_of_ones_own() -> None:
    overrides = ["network.build=wide_network:build", "network.kwargs.width=16"]
    scenario = load_scenario(EXAMPLES / "corridor.toml", overrides)
    outcome = run_in_memory(scenario)
    ends = {row.task: row for row in outcome.rows if row.learned is not None}
    assert {task: row.learned for task, row in ends.items()} == {1: True, 2: True}
    assert all((row.cluster_reward or 0) >= 5 for row in ends.values())
    plays(scenario, outcome, "fl")
    told = check_model(outcome.learned["fl", 1])
    assert told.network is not None
    assert [layer.layer for layer in told.network] == ["flatten", "linear", "tanh", "linear"]


def jouleswarm(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "jouleswarm", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=150, check=False)


@pytest.fixture(scope="module")
def corridor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run over the bus of an environment and a network of one's own."""
    out = tmp_path_factory.mktemp("runs")
    sets = [*BRIEF, "network.build=wide_network:build", "network.kwargs.width=16", 'methods=["maml","fl"]']
    told = [part for each in sets for part in ("--set", each)]
    done = jouleswarm("run", "examples/corridor.toml", "--out", str(out), "--run-id", "corridor", "--no-figures", *told)
    assert done.returncode == 0, done.stderr
    assert "What each arm learned and cost" in done.stdout
    return out / "corridor"


def test_a_run_keeps_what_came_in_by_the_doors_and_all_sizes(corridor: Path) -> None:
    manifest = json.loads((corridor / "manifest.json").read_text())
    assert sorted(path.name for path in (corridor / "doors").iterdir()) == ["corridor.py", "wide_network.py"]
    assert sorted(manifest["doors"]) == ["corridor.py", "wide_network.py"]
    assert manifest["interface"]["tensors"] == [
        ["1.weight", [16, 7]], ["1.bias", [16]], ["3.weight", [2, 16]], ["3.bias", [2]],
    ]  # fmt: skip
    assert manifest["interface"]["spaces"]["observation"] == {"shape": [7], "dtype": "float32", "values": None}


def test_what_goes_over_the_bus_is_metered_and_priced_as_it_is(corridor: Path) -> None:
    run = load_run(corridor)
    assert run.status == "complete"
    assert run.misfits == ()
    up = [row for row in run.meter_rows if (row.side, row.direction) == ("client", "out") and "/ul/" in row.topic]
    messages, payload = sum(row.messages for row in up), sum(row.payload_bytes for row in up)
    assert messages == 2 * 2 * 8  # rounds x training robots x motions
    assert messages * (28 + 300) < payload < messages * (28 + 600)
    assert {row.rmse_m for row in run.rows} == {None}
    assert interface_of(run.scenario).entries == [112, 16, 32, 2]


def test_a_report_needs_neither_the_environment_nor_the_network(corridor: Path, tmp_path: Path) -> None:
    """As on a machine that lacks a package which the user's file imports."""
    import hashlib
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(corridor, copy)
    manifest = json.loads((copy / "manifest.json").read_text())
    for name in ("corridor.py", "wide_network.py"):
        file = copy / "doors" / name
        file.write_text("import nothing_of_this_name\n")
        manifest["doors"][name] = hashlib.sha256(file.read_bytes()).hexdigest()
    (copy / "manifest.json").write_text(json.dumps(manifest))
    printed = [jouleswarm("report", str(path), "--details").stdout.replace(str(path), "") for path in (corridor, copy)]
    assert "scenario" in printed[0]
    assert printed[0] == printed[1]


def test_a_row_s_measures_are_left_out_where_there_are_none(corridor: Path) -> None:
    lines = (corridor / "rounds.jsonl").read_text().splitlines()
    assert not any("measures" in line for line in lines)
    row: dict[str, Any] = {"phase": "fl", "arm": "fl", "task": 1, "agent": 1, "round": 1, "seconds": 0.1}
    told = RoundRow.model_validate({**row, "measures": {"steps": 3.0}})
    assert RoundRow.model_validate_json(told.model_dump_json()) == told
    assert told.model_dump()["measures"] == {"steps": 3.0}


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (("environment=corridr:Corridor",), "environment 'corridr:Corridor': no corridr.py in "),
        (("tasks=[{id=1,kwargs={lenght=3}},{id=2}]",), "unexpected keyword argument 'lenght' (kwargs: lenght)"),
        (("network.build=corridor:Corridor",), "network 'corridor:Corridor': "),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(overrides: tuple[str, ...], said: str, tmp_path: Path) -> None:
    told = [part for each in overrides for part in ("--set", each)]
    done = jouleswarm("run", "examples/corridor.toml", "--out", str(tmp_path / "runs"), *told)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert said in line
    assert not (tmp_path / "runs").exists()


def test_a_robot_started_by_hand_says_it_too(broker: str) -> None:
    command = [sys.executable, "-m", "agents", "--id", "1", "--broker", broker, "--scenario", "examples/corridor.toml"]
    command += ["--set", "tasks=[{id=1,kwargs={length=3,right=3,left=4}},{id=2}]"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 2
    assert "unexpected keyword argument 'left'" in done.stderr.splitlines()[-1]
