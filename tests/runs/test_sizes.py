"""What rounds should compute and move by a scenario's settings, worked out by hand."""

import pytest

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Network
from jouleswarm.energy.closed_form import TABLE_I
from jouleswarm.energy.facts import Counts, StageCounts
from jouleswarm.runs.sizes import expected_counts, scenario_sizes
from tests.made_up import qnetwork, with_network


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
    built = sum(parameter.numel() for parameter in qnetwork(network).parameters())
    scenario: Scenario = facts.scenario.model_copy(update={"network": with_network(network).network})
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


@pytest.mark.parametrize("method", ["fomaml", "anil"])
def test_meta_learning_with_query_batches_has_the_closed_form_of_maml(facts, method: str) -> None:
    of_maml = expected_counts(facts.scenario, "maml", 3, {1: 4, 2: 6}, TABLE_I)
    assert expected_counts(facts.scenario, method, 3, {1: 4, 2: 6}, TABLE_I) == of_maml


@pytest.mark.parametrize("method", ["reptile", "multitask"])
def test_meta_learning_without_query_batches_computes_plain_gradients_only(facts, method: str) -> None:
    ml = expected_counts(facts.scenario, method, 3, {1: 4, 2: 6}, TABLE_I).ml
    assert (ml.gradients_support, ml.gradients_query) == (120, 0)  # 3 rounds x 2 robots x (10 + 10)


# No convolution: 1 x 1 x 4 inputs, 3 dense, 4 actions: tensors of 12, 3, 12 and 4 entries, 31 in all.
TINY = Network(width=1, height=1, conv=(), dense=(3,))


@pytest.mark.parametrize(
    ("codec", "first", "later", "meta"),
    [  # the meta-model has a last layer, 12 + 4, more for each of 2 training tasks
        ("float32", 124, 124, 124 + 2 * 64),
        ("float16", 62, 62, 62 + 2 * 32),
        ("int8", 31 + 4 * 4, 31 + 4 * 4, 31 + 4 * 4 + 2 * (16 + 2 * 4)),
        ("topk", 124, 8 * 4, 124 + 2 * 64),  # 10% of 31 entries: 4, of 4 bytes and a place each
    ],
)
def test_weights_are_sized_as_their_codec_writes_them(facts, codec: str, first: int, later: int, meta: int) -> None:
    federation = facts.scenario.federation.model_copy(update={"codec": codec, "topk_share": 0.1})
    scenario = facts.scenario.model_copy(update={"network": TINY, "federation": federation})
    sizes = scenario_sizes(scenario)
    assert (sizes.first_weights_bytes, sizes.weights_bytes, sizes.meta_model_of) == (first, later, {"maml": meta})
    expected = expected_counts(scenario, "maml", 3, {1: 4, 2: 6}, sizes)
    assert expected.ml.downlink_bytes == 4 * meta  # robots
    assert expected.fl.sidelink_bytes == 2 * (first + 3 * later) + 2 * (first + 5 * later)


@pytest.mark.parametrize(("codec", "frame"), [("raw", 640 * 480 * 4), ("resized", 96 * 72 * 4), ("png", 640 * 480 * 4)])
def test_experience_is_sized_as_its_codec_writes_it_and_png_as_raw(facts, codec: str, frame: int) -> None:
    meta = facts.scenario.meta.model_copy(update={"experience_codec": codec})
    assert scenario_sizes(facts.scenario.model_copy(update={"meta": meta})).experience_bytes == 20 * frame
