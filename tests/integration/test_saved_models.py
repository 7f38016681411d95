"""A model's file is all that its user needs: the example of docs/models.md, run as it is printed there."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.models import encode_model
from jouleswarm.common.wire.saved_models import check_model
from jouleswarm.learning.networks import build_qnetwork, to_weights
from jouleswarm.simulation import Outcome, run_in_memory

ROOT = Path(__file__).parents[2]
TASKS = (1, 2)
BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "models.md").read_text(encoding="utf-8"), re.DOTALL)
(EXAMPLE,) = (block for block in BLOCKS if "safetensors" in block)


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    # Three rounds: task 2 of fl is at its exit by then, the others are not.
    overrides = ['methods=["multitask","fl","centralized"]', "federation.max_rounds=3", "meta.t0=2"]
    return load_scenario(ROOT / "scenarios" / "toy.toml", [*overrides, "meta.snapshots=[2]"])


@pytest.fixture(scope="module")
def outcome(scenario: Scenario) -> Outcome:
    return run_in_memory(scenario)


def rewards(scenario: Scenario, payload: bytes, run: Path, capsys: pytest.CaptureFixture[str]) -> tuple[float, float]:
    """What the example prints of a file: its own reward, and the recorded one."""
    (run / "manifest.json").write_text(json.dumps({"scenario": scenario.model_dump(mode="json")}))
    (run / "model.safetensors").write_bytes(payload)
    exec(compile(EXAMPLE, "docs/models.md", "exec"), {"path": run / "model.safetensors", "run": run})
    own, recorded = re.fullmatch(r"(\S+) recorded: (\S+)\n", capsys.readouterr().out).groups()  # type: ignore[union-attr]
    return float(own), float(recorded)


@pytest.mark.parametrize("arm", ["fl", "multitask", "centralized"])
def test_the_example_earns_the_reward_that_was_recorded(
    scenario: Scenario, outcome: Outcome, arm: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for task in TASKS:
        payload = outcome.learned[arm, task]
        own, recorded = rewards(scenario, payload, tmp_path, capsys)
        assert own == recorded
        agent = check_model(payload).agent
        told = [row for row in outcome.rows if (row.arm, row.task, row.agent, row.phase) == (arm, task, agent, "fl")]
        assert recorded == told[-1].reward


def test_the_file_says_all_that_the_network_does_to_a_frame(scenario: Scenario, outcome: Outcome) -> None:
    header = check_model(outcome.learned["fl", 1])
    assert header.input is not None
    network = scenario.network
    assert (header.input.height, header.input.width) == (network.height, network.width)
    assert header.input.channels == ("red", "green", "blue", "depth")
    assert header.actions == ("forward", "backward", "left", "right")
    # By hand: 0, 128 and 255 become -2, 0 and 127/64.
    frame = np.zeros((1, 1, 3, 4), np.uint8)
    frame[0, 0, 1:] = [[128] * 4, [255] * 4]
    expected = [(value - header.input.subtract) / header.input.divide for value in (0, 128, 255)]
    assert expected == [-2.0, 0.0, 127 / 64]
    assert build_qnetwork(scenario).prepare(frame)[0, 0, 0].tolist() == expected


def test_a_meta_model_says_which_tasks_have_a_last_layer_of_their_own(scenario: Scenario, outcome: Outcome) -> None:
    payload = outcome.snapshots["multitask", 2]
    header, tensors = check_model(payload), safetensors.numpy.load(payload)
    assert header.heads == scenario.meta.training_tasks
    own = {name.split("/")[0] for name in tensors if "/" in name}
    assert own == {f"task{task}" for task in header.heads or ()}
    assert header.evaluation is None


def test_what_goes_to_neighbours_every_round_does_not_say_it_again(scenario: Scenario) -> None:
    weights = to_weights(build_qnetwork(scenario, 1))
    payload = encode_model(weights, ModelHeader(task=1, agent=1, round=1, reward=1.0, rewards={1: (1, 1.0)}), 2)
    (length,) = np.frombuffer(payload[:8], "<u8")
    metadata = json.loads(payload[8 : 8 + int(length)])["__metadata__"]
    assert not {"input", "network", "actions"} & set(metadata)
