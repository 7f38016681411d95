"""What quick will cost, worked out by hand: 12 robots in 6 pairs, 3 that train, the compact network.

Network: 36 x 48 x 4 -> 16 x 11 x 15 -> 32 x 5 x 7 -> 128 -> 4, of 1616 + 4640 + 143,488 + 516 = 150,260 float32.
"""

from __future__ import annotations

import pytest

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.energy.facts import Counts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.published import published
from jouleswarm.runs.foretold import compare, foretold_facts, room_of, round_lines
from jouleswarm.runs.speed import Speed, estimated_s

WEIGHTS = 4 * 150_260
META = WEIGHTS + 3 * 4 * 516  # a last layer for each of the 3 training tasks
QUICK = load_scenario("quick")
STAGED, PLAIN = QUICK.arms


def test_a_round_by_phase_and_cause() -> None:
    found = {(line.arm, line.phase, line.cause): (line.amount, line.joules) for line in round_lines(QUICK)}
    expected = {
        ("fl", "fl", "computing_robots"): (240, 489.6),  # 12 robots x 20 batches x 2.04 J
        ("fl", "fl", "sidelink"): (12 * WEIGHTS, 12 * WEIGHTS * 8 / 500e3),
        ("multitask", "ml", "computing_datacenter"): (60, 1.67 * 60 * 11.8),
        ("multitask", "ml", "uplink"): (3 * 24_576_000, 3 * 24_576_000 * 8 / 200e3),
        ("multitask", "ml", "downlink"): (12 * META, 12 * META * 8 / 200e3),
    }
    expected |= {("multitask", *key[1:]): value for key, value in expected.items() if key[0] == "fl"}
    assert found == {key: pytest.approx(value) for key, value in expected.items()}
    assert [line.cause for line in round_lines(QUICK) if line.once] == ["downlink"]
    pair = [line.joules for line in round_lines(QUICK) if line.arm == "fl"]
    assert sum(pair) / 6 == pytest.approx(100.833, abs=1e-3)  # a cluster-round; 100.866 J are counted, with headers


def test_the_whole_is_the_stage_and_all_rounds() -> None:
    facts = foretold_facts(QUICK, STAGED, 90, 20)
    bill = literal.price(facts, QUICK.energy)
    assert bill.ml.total_j == pytest.approx(90 * (1182.36 + 2949.12) + 12 * META * 8 / 200e3)
    assert bill.fl.total_j == pytest.approx(20 * 6 * 100.83328)
    implied = published.price(facts, QUICK.energy)
    assert implied is not None
    assert implied.total_j == pytest.approx(90 * 352.4 + 120 * 246.3)
    assert foretold_facts(QUICK, PLAIN, 0, 20).counts.ml == Counts()


def test_the_first_message_of_a_codec_that_builds_on_it_is_no_usual_round() -> None:
    topk = load_scenario("quick", ["federation.codec=topk", "federation.topk_share=0.01"])
    (side,) = [line.amount for line in round_lines(topk) if (line.arm, line.cause) == ("fl", "sidelink")]
    assert side < 12 * WEIGHTS / 20


def test_memory_and_disk() -> None:
    room, frame = room_of(QUICK), 36 * 48 * 4 + 21
    robot = (2000 + 2 * 20) * frame + 5 * WEIGHTS
    center = 3 * (5000 + 2 * 20) * frame + 5 * WEIGHTS
    assert (room.robot, room.datacenter, room.whole) == (robot, center, 12 * robot + center)
    alone = room_of(load_scenario("quick", ["methods=['fl']", "learning.optimizer=sgd"]))
    assert (alone.robot, alone.datacenter) == ((2000 + 2 * 20) * frame + 3 * WEIGHTS, 0)


def test_time_is_gradients_and_motions_over_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
    # stage: 90 x 60 gradients, 90 x 60 motions; then twice 10 rounds of 12 robots, 20 gradients and 2 x 20 motions each
    expected = (5400 * 0.01 + 5400 * 0.001 + 2 * 10 * 12 * (20 * 0.01 + 40 * 0.001)) / 2
    assert estimated_s(QUICK, Speed(0.01, 0.001, 0, has_guide=True), 10) == pytest.approx(expected)


def test_foretold_against_counted_is_of_a_round() -> None:
    foretold = foretold_facts(QUICK, STAGED, 90, 10)
    found = compare(foretold, foretold)
    assert found["ml uplink"] == (3 * 24_576_000, 3 * 24_576_000)
    assert found["fl sidelink"] == (2 * WEIGHTS, 2 * WEIGHTS)  # of one cluster
    assert set(found) == {"ml uplink", "ml downlink", "fl sidelink"}
