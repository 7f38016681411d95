"""A warm start: a model of an earlier run in place of random weights, for whatever begins to learn."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.learning.start import saved_start, start_weights
from jouleswarm.methods.meta_stage import MetaStage
from jouleswarm.simulation import Outcome, run_in_memory

ROOT = Path(__file__).parents[2]
TOY = (ROOT / "scenarios" / "toy.toml").read_text()
SMALL = ("federation.max_rounds=1", "meta.t0=1", "learning.motions_per_round=6", "learning.batches_per_round=2")


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """A folder with a scenario and the models of a run of it."""
    folder = tmp_path_factory.mktemp("earlier")
    (folder / "toy.toml").write_text(TOY)
    outcome = run_in_memory(load_scenario(folder / "toy.toml", SMALL))
    (folder / "weights").mkdir()
    (folder / "weights" / "fl-task1.safetensors").write_bytes(outcome.learned["fl", 1])
    (folder / "meta.safetensors").write_bytes(outcome.snapshots["maml", 1])
    return folder, outcome


def begun_from(folder: Path, name: str, *more: str) -> Scenario:
    return load_scenario(folder / "toy.toml", [*SMALL, f"learning.init={name}", *more])


def same(ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray]) -> bool:
    return ours.keys() == theirs.keys() and all(np.array_equal(ours[name], theirs[name]) for name in ours)


def test_robots_of_every_task_begin_from_the_model(earlier: tuple[Path, Outcome]) -> None:
    folder, outcome = earlier
    scenario = begun_from(folder, "weights/fl-task1.safetensors")
    learned = safetensors.numpy.load(outcome.learned["fl", 1])
    assert all(same(start_weights(scenario, task), learned) for task in (1, 2))
    assert list(scenario.files) == ["fl-task1.safetensors"]


def test_of_a_meta_model_a_task_has_its_own_last_layer_and_others_their_mean(earlier: tuple[Path, Outcome]) -> None:
    folder, outcome = earlier
    scenario = begun_from(folder, "meta.safetensors")
    meta = safetensors.numpy.load(outcome.snapshots["maml", 1])
    first, second = (start_weights(scenario, task) for task in (1, 2))
    assert np.array_equal(first["7.weight"], meta["task1/7.weight"])
    assert np.array_equal(second["7.weight"], meta["7.weight"])


@pytest.mark.parametrize(("name", "of_the_task"), [("meta.safetensors", "task1/7.bias"), (None, "7.bias")])
def test_a_stage_begins_from_it_with_the_heads_that_it_has(
    earlier: tuple[Path, Outcome], name: str | None, of_the_task: str
) -> None:
    folder, _ = earlier
    scenario = begun_from(folder, name or "weights/fl-task1.safetensors", "meta.training_tasks=[1,2]")
    saved = saved_start(scenario)
    stage = scenario.method("maml").stage(scenario)
    assert saved is not None
    assert isinstance(stage, MetaStage)
    begun = stage.weights()
    assert np.array_equal(begun["0.weight"], saved["0.weight"])
    assert np.array_equal(begun["task1/7.bias"], saved[of_the_task])
    assert np.array_equal(begun["task2/7.bias"], saved["7.bias"])


@pytest.mark.parametrize("method", ["fl", "isolated", "fedavg", "centralized", "maml"])
def test_every_arm_learns_on_from_it(earlier: tuple[Path, Outcome], method: str) -> None:
    """A step so small that it moves nothing: what is handed in is what was begun from."""
    folder, outcome = earlier
    still = ("learning.optimizer=sgd", "learning.lr=1e-30", "meta.meta_lr=1e-30", f"methods=['{method}']")
    found = run_in_memory(begun_from(folder, "weights/fl-task1.safetensors", *still))
    learned = safetensors.numpy.load(outcome.learned["fl", 1])
    for task in (1, 2):
        ended = safetensors.numpy.load(found.learned[method, task])
        assert all(np.allclose(ended[name], learned[name], rtol=0, atol=1e-7) for name in learned)


def test_what_is_learned_depends_on_the_file(earlier: tuple[Path, Outcome], tmp_path: Path) -> None:
    folder, _ = earlier
    before = begun_from(folder, "meta.safetensors").determines
    (tmp_path / "toy.toml").write_text(TOY)
    (tmp_path / "meta.safetensors").write_bytes((folder / "weights" / "fl-task1.safetensors").read_bytes())
    assert begun_from(tmp_path, "meta.safetensors").determines != before


@pytest.mark.parametrize(
    ("name", "more", "told"),
    [
        ("nowhere.safetensors", (), r"no such file; expected a model of a run's weights/"),
        ("toy.toml", (), r"cannot be read \(model: .*\); expected a file of a run's weights/"),
        (
            "meta.safetensors",
            ("network.dense=[16]",),
            r"5\.weight is \[32, 240\], expected \[16, 240\]: a model of the",
        ),
        ("meta.safetensors", ("network.dense=[]",), r"5\.weight is \[32, 240\], expected \[4, 240\]"),
        ("meta.safetensors", ("network.dense=[32,32]",), r"7\.weight is \[4, 32\], expected \[32, 32\]"),
    ],
)
def test_a_model_of_another_network_is_one_line_and_exit_code_2(
    earlier: tuple[Path, Outcome], name: str, more: tuple[str, ...], told: str
) -> None:
    folder, _ = earlier
    with pytest.raises(ConfigurationError, match=rf"learning\.init {folder}/{name}: {told}"):
        saved_start(begun_from(folder, name, *more))


def test_the_command_says_so_before_anything_is_written(earlier: tuple[Path, Outcome], tmp_path: Path) -> None:
    folder, _ = earlier
    changes = ["--set", "learning.init=meta.safetensors", "--set", "network.dense=[16]"]
    where = [str(folder / "toy.toml"), "--out", str(tmp_path / "runs")]
    command = [sys.executable, "-m", "jouleswarm", "run", *where, *changes]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert "learning.init" in line
    assert not (tmp_path / "runs").exists()
