"""The examples of methods of one's own, by values worked out by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.methods.graph import neighbourhood_of
from jouleswarm.methods.method import ClusterRound, Method, Update

EXAMPLES = Path(__file__).parents[2] / "examples"


def vector(*values: float) -> dict[str, np.ndarray]:
    return {"w": np.array(values, np.float32)}


@pytest.fixture(scope="module")
def median() -> Method:
    found: Method = load_scenario(EXAMPLES / "median.toml").method("median")
    return found


@pytest.mark.parametrize("name", ["median", "fedprox"])
def test_an_example_is_short(name: str) -> None:
    assert len((EXAMPLES / f"{name}.py").read_text().splitlines()) < 60


def test_the_median_leaves_out_who_is_far_off(median: Method) -> None:
    theirs = {2: Update(vector(2, -1, 8), 20, 1), 3: Update(vector(1e4, 1e4, -1e4), 20, 1)}
    mixed = median.mix(vector(1, 5, 9), theirs, 0.5)
    assert mixed["w"].tolist() == [2, 5, 8]  # of 1, 2, 1e4; of 5, -1, 1e4; of 9, 8, -1e4
    assert mixed["w"].dtype == np.float32


def test_the_median_of_two_is_half_way(median: Method) -> None:
    assert median.mix(vector(1, 4), {2: Update(vector(2, 0), 20, 1)}, 0.5)["w"].tolist() == [1.5, 2]


def test_with_a_lossy_codec_what_was_not_told_stays_on_top(median: Method) -> None:
    own, told = vector(1.25, 4), vector(1, 4)
    mixed = median.mix_lossy(own, told, {2: Update(vector(2, 0), 20, 1)}, 0.5)
    assert mixed["w"].tolist() == [1.75, 2]  # half way from what was told, and 0.25


def test_the_penalty_of_fedprox_pulls_back_to_where_the_round_began() -> None:
    method: Method = load_scenario(EXAMPLES / "fedprox.toml").method("fedprox")
    params = {"a": torch.tensor([1.0, 3.0], requires_grad=True), "b": torch.tensor(2.0, requires_grad=True)}
    start = {"a": torch.tensor([1.0, 1.0]), "b": torch.tensor(5.0)}
    penalty = method.penalty(params, start)
    assert isinstance(penalty, torch.Tensor)
    assert penalty.item() == pytest.approx(0.01 / 2 * (0 + 4 + 9))
    penalty.backward()  # type: ignore[no-untyped-call]
    # mu (W - W_start)
    assert params["a"].grad is not None
    assert params["b"].grad is not None
    assert params["a"].grad.tolist() == pytest.approx([0, 0.02])
    assert params["b"].grad.item() == pytest.approx(-0.03)


def test_fedprox_by_server_averages_by_samples_and_robots_go_on_from_that() -> None:
    method: Method = load_scenario(EXAMPLES / "fedprox.toml").method("fedprox-server")
    updates = {1: Update(vector(1), 10, 4), 2: Update(vector(5), 30, 4)}
    assert method.serve(ClusterRound(1, 4, updates)) == ({"w": np.array([4], np.float32)}, 0)  # 1/4 + 15/4
    assert method.mix(vector(9), {0: Update(vector(4), 40, 4)}, 0.5)["w"].tolist() == [4]


def test_the_example_s_edges_are_a_line_of_three_in_each_cluster() -> None:
    scenario = load_scenario(EXAMPLES / "median.toml")
    neighbours = {agent: neighbourhood_of(scenario, agent).neighbours for agent in scenario.agents}
    assert neighbours == {1: (2,), 2: (1, 3), 3: (2,), 4: (5,), 5: (4, 6), 6: (5,)}
    assert {neighbourhood_of(scenario, agent).diameter for agent in scenario.agents} == {2}
