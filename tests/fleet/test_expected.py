"""What rounds should compute and move by a scenario's settings, worked out by hand."""

import pytest

from common.energy import TABLE_I, Counts, StageCounts
from common.qnetwork import build_qnetwork
from common.scenario import Scenario
from common.settings import Network
from fleet.expected import expected_counts, scenario_sizes


def test_sizes_of_the_default_scenario_are_the_papers(facts) -> None:
    sizes = scenario_sizes(facts.scenario)
    assert sizes.experience_bytes == 24_576_000  # 20 x 640 x 480 x 4
    assert sizes.weights_bytes == 5_565_072  # 1,391,268 float32
    assert (sizes.support_batches, sizes.query_batches, sizes.robot_batches) == (10, 10, 20)


@pytest.mark.parametrize(
    "network",
    [Network(), Network(width=48, height=36, conv=((8, 5, 2),), dense=(64, 16)), Network(conv=(), dense=(3,))],
)
def test_weights_are_sized_as_the_network_that_is_built(facts, network: Network) -> None:
    built = sum(parameter.numel() for parameter in build_qnetwork(network).parameters())
    scenario: Scenario = facts.scenario.model_copy(update={"network": network})
    assert scenario_sizes(scenario).weights_bytes == 4 * built


def test_closed_form_of_the_run(facts) -> None:
    expected = expected_counts(facts.scenario, "maml", 3, {1: 4, 2: 6}, TABLE_I)
    assert (expected.ml.gradients_support, expected.ml.gradients_query, expected.fl.gradients_robots) == (60, 60, 400)
    assert expected.ml.uplink_bytes == pytest.approx(3 * 2 * 24.6e6)
    assert expected.ml.downlink_bytes == pytest.approx(4 * 5.6e6)
    assert expected.fl.sidelink_bytes == pytest.approx(10 * 2 * 5.6e6)


def test_closed_form_without_meta_learning(facts) -> None:
    expected = expected_counts(facts.scenario, "fl", 0, {1: 10, 2: 20}, TABLE_I)
    assert expected.ml == Counts()
    assert expected.fl.gradients_robots == 1200  # 30 rounds x 2 robots x 20 batches


# 10 rounds x 2 robots = 20 robot rounds, of 20 batches, 24.6 MB of experience and 5.6 MB of weights each
SERVED = {
    "isolated": Counts(gradients_robots=400),
    "fedavg": Counts(gradients_robots=400, uplink_bytes=112e6, downlink_bytes=112e6),
    "centralized": Counts(gradients_support=400, uplink_bytes=492e6, downlink_bytes=112e6),
}


@pytest.mark.parametrize("method", SERVED)
def test_closed_form_of_methods_without_sidelinks(facts, method: str) -> None:
    expected = expected_counts(facts.scenario, method, 0, {1: 4, 2: 6}, TABLE_I)
    assert expected == StageCounts(fl=SERVED[method])


@pytest.mark.parametrize("method", ["fomaml", "reptile", "anil", "multitask"])
def test_every_meta_learning_method_has_the_closed_form_of_maml(facts, method: str) -> None:
    of_maml = expected_counts(facts.scenario, "maml", 3, {1: 4, 2: 6}, TABLE_I)
    assert expected_counts(facts.scenario, method, 3, {1: 4, 2: 6}, TABLE_I) == of_maml
