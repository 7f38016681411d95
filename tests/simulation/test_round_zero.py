"""Round 0: a task that the model to start from already does is learned before its first round; all decide alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

from jouleswarm.agents.explorer import Explorer
from jouleswarm.agents.trial import Trial
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.saved_models import check_model, encode_saved_model
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.literal import bill
from jouleswarm.fleet.learning import check_learning
from jouleswarm.learning.networks import build_qnetwork, shapes_of, use_of
from jouleswarm.learning.start import start_weights
from jouleswarm.runs.arm_facts import arm_facts
from jouleswarm.runs.facts import task_results, zero_shot_share
from jouleswarm.runs.traffic import traffic
from jouleswarm.simulation import run_in_memory
from tests.simulation.test_killed import SMALL, TOY, Death, Deployment

# Always on: of task 1, 4 places far, the return is 2 x (1 + 0.99 x 2 + 0.99^2 x 3 + 0.99^3 x 4) = 19.6; of task 2,
# 1 place far, 2 x 1 = 2.
LINE = """
name = "line"
environment = "tests.worlds:Known"
methods = ["fl"]
learning = { batches_per_round = 2, motions_per_round = 3, max_episode_steps = 8 }
federation = { target_reward = 15, reward_window = 3, max_rounds = 4 }
network = { dense = [4] }
[[tasks]]
id = 1
[[tasks]]
id = 2
kwargs = { end = 1 }
"""


def solved(folder: Path, *more: str) -> Scenario:
    """Two tasks whose robots start with a network that always goes on."""
    (folder / "line.toml").write_text(LINE)
    scenario = load_scenario(folder / "line.toml", more)
    weights = {name: np.zeros(shape, np.float32) for name, shape in shapes_of(build_qnetwork(scenario)).items()}
    list(weights.values())[-1][1] = 1.0
    model = encode_saved_model(weights, ModelHeader(task=1, agent=1, round=1), use_of(scenario))
    (folder / "solved.safetensors").write_bytes(model)
    return load_scenario(folder / "line.toml", [*more, "learning.init=solved.safetensors"])


@pytest.mark.parametrize("method", ["fl", "fedavg", "centralized", "isolated"])
def test_a_solved_task_takes_no_round_and_no_joule_and_another_goes_on(method: str, tmp_path: Path) -> None:
    scenario = solved(tmp_path, f"methods=['{method}']")
    outcome = run_in_memory(scenario)
    meter = outcome.hub.meter.rows()
    first, second = task_results(scenario, outcome.rows, method)
    assert (first.rounds, first.learned, first.full_window, first.partial_window) == (0, True, 0, 0)
    assert (second.rounds, second.learned, second.full_window, second.partial_window) == (4, False, None, None)
    assert first.reward == pytest.approx(2 * (1 + 0.99 * 2 + 0.99**2 * 3 + 0.99**3 * 4))
    assert zero_shot_share([first, second]) == 0.5
    rows = [row for row in outcome.rows if row.agent and row.round == 0]
    # three episodes, as R's window has, of 4 motions or of 1
    assert {(row.task, row.agent): (row.motions, row.evaluation_motions, row.gradients) for row in rows} == {
        (1, 1): (0, 12, 0), (1, 2): (0, 12, 0), (2, 3): (0, 3, 0), (2, 4): (0, 3, 0),
    }  # fmt: skip
    later = {(row.motions, row.task) for row in outcome.rows if row.agent and row.round}
    assert later == {(3, 2)}
    links = (Link.SIDELINK, Link.UPLINK, Link.DOWNLINK)
    assert [traffic(meter, method, link, 1, phase="fl").messages for link in links] == [0, 0, 0]
    assert bill(arm_facts(scenario, outcome.rows, meter, method).of_task(1).counts, scenario.energy).total_j == 0
    handed_in = outcome.learned[method, 1]
    start = start_weights(scenario, 1)
    assert all(np.array_equal(tensor, start[name]) for name, tensor in safetensors.numpy.load(handed_in).items())
    told = check_model(handed_in)
    assert (told.round, told.rewards[1][0]) == (0, 0)
    assert told.evaluation is not None
    check_learning(scenario, [row for row in outcome.rows if row.task == 1])  # no gradient, and a run all the same


REACHED = "federation.target_reward=-1e9"


@pytest.mark.parametrize(
    ("method", "death"),
    [
        # a robot's presence: 0, 1, then 1 with its reward of round 0, 2, and that it is done
        ("fl", Death("agent-1", "presence", 3)),  # on disk, and nobody has heard it
        ("fl", Death("agent-1", "presence", 3, sent=True)),
        ("fl", Death("agent-1", "round", 1, sent=True)),
        ("fl", Death("agent-1", "learned", 1)),
        ("fl", Death("agent-1", "presence", 4, sent=True)),  # ended, and its neighbour may not have decided
        ("isolated", Death("agent-2", "presence", 3, sent=True)),
        ("fedavg", Death("agent-1", "presence", 4)),
        ("centralized", Death("agent-1", "presence", 3)),
    ],
    ids=str,
)
@pytest.mark.parametrize("target", [REACHED, "federation.target_reward=1000"])
def test_who_is_killed_in_round_0_comes_back_to_the_same_decision(
    method: str, death: Death, target: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    overrides = (f"methods=['{method}']", "federation.max_rounds=1", "federation.robots_per_cluster=2", target)
    scenario = load_scenario(TOY, [*SMALL, *overrides])
    undisturbed = run_in_memory(scenario)
    expected = {row.model_dump_json(exclude={"seconds", "refused"}) for row in undisturbed.rows}
    assert max(row.round for row in undisturbed.rows) == (0 if target == REACHED else 1)
    end = Deployment(scenario, tmp_path).run(death)
    assert end.rows == expected
    learned = {f"{arm}/tlm/{task}/learned": payload for (arm, task), payload in undisturbed.learned.items()}
    assert end.models == learned


def test_what_was_told_holds_though_the_second_life_sees_another_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lives: list[int] = []

    def evaluate(self: Explorer, policy: object, episodes: int) -> list[Trial]:
        lives.append(self._agent)
        return [Trial(100.0 if lives.count(self._agent) == 1 else -100.0, {}, 1)]

    monkeypatch.setattr(Explorer, "evaluate_at_start", evaluate)
    scenario = load_scenario(TOY, [*SMALL, "methods=['fl']", "federation.target_reward=50"])
    deployment = Deployment(scenario, tmp_path)
    deployment.run(Death("agent-1", "presence", 3, sent=True))  # its neighbour decides by 100, and so does it
    assert lives.count(1) == 2


@pytest.mark.parametrize("method", ["fl", "fedavg"])
def test_in_a_ring_rewards_are_passed_on(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Explorer, "evaluate_at_start", lambda self, *_: [Trial(float(self._agent), {}, 1)])
    ring = ("federation.robots_per_cluster=5", "federation.topology=ring", "federation.max_rounds=1")
    outcome = run_in_memory(load_scenario(TOY, [*SMALL, *ring, f"methods=['{method}']"]))
    told = {(row.task, row.cluster_reward) for row in outcome.rows if row.round == 0}
    assert told == {(1, 3.0), (2, 8.0)}  # (1 + 2 + 3 + 4 + 5) / 5, (6 + ... + 10) / 5
