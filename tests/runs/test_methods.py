"""What each method's arm is charged for, from made-up facts worked out by hand.

2 tasks x 2 robots (task 1: robots 1, 2; task 2: robots 3, 4). Meta-learning of 3 rounds on both tasks, 10 + 10
gradients a task and round.
"""

from typing import Any

import pytest

from jouleswarm.common.meter.meter import Meter, MeterRow
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.energy.facts import Counts, StageCounts
from jouleswarm.energy.literal import bill
from jouleswarm.runs.facts import meta_counts, meta_rounds, task_counts, task_results
from jouleswarm.runs.summary import summarise

RUN = "r"
TASKS = [{"id": task, "map": "E*\n.X"} for task in (1, 2)]


def scenario(*methods: str, **changes: Any) -> Scenario:
    meta = {"t0": 3, "training_tasks": [1, 2], "adapt_from": [1]}
    data = {"name": "x", "world": {"rows": 2, "cols": 2}, "tasks": TASKS, "methods": methods, "meta": meta}
    return scenario_from(data | changes, "x")


def row(**fields: Any) -> RoundRow:
    return RoundRow.model_validate({"phase": "fl", "task": 1, "seconds": 0.1, **fields})


def stage(sizes: tuple[int | None, ...], arm: str = "maml") -> list[RoundRow]:
    """Rows of the data center; `sizes` are a task's experience bytes of each round."""
    return [
        row(
            phase="maml", arm=arm, task=task, agent=0, round=round_, gradients=20, gradients_support=10,
            gradients_query=10, experience_bytes=size,
        )
        for round_, size in enumerate(sizes, start=1)
        for task in (1, 2)
    ]  # fmt: skip


def delivered(client: str, topic: str, payload: int, sender: str = "") -> list[MeterRow]:
    meter = Meter("broker")
    meter.count(client, topic, "out", payload, payload + 50)
    if sender:
        meter.count(sender, topic, "in", payload, payload + 50)
    return meter.rows()


def uplink(payload: int) -> list[MeterRow]:
    return delivered("datacenter", topics.experience(RUN, "maml", 1, 1), payload)


def test_an_arm_from_an_earlier_meta_model_pays_for_the_rounds_up_to_it() -> None:
    rows = stage((20_000, 20_000, 30_000))
    meter = uplink(140_000) + delivered("agent-1", topics.meta_model(RUN, "maml-t1"), 5_000)
    # 2 tasks x 1 round of 10 + 10 gradients, 2 x 20,000 B up; its own downlink
    early = Counts(gradients_support=20, gradients_query=20, uplink_bytes=40_000, downlink_bytes=5_000)
    assert meta_counts(rows, meter, "maml-t1") == early
    # the last model: all 3 rounds and all that went up; nothing of the other arm's downlink
    assert meta_counts(rows, meter, "maml") == Counts(gradients_support=60, gradients_query=60, uplink_bytes=140_000)
    assert (meta_rounds(rows, "maml-t1"), meta_rounds(rows, "maml-t2"), meta_rounds(rows, "maml")) == (1, 2, 3)


def test_what_was_sent_twice_is_spread_over_the_rounds() -> None:
    rows = stage((20_000, 20_000, 30_000))
    # a tenth more than was learned from: 154,000 B x 40,000 / 140,000
    assert meta_counts(rows, uplink(154_000), "maml-t1").uplink_bytes == pytest.approx(44_000)


@pytest.mark.parametrize("sizes", [(None, None, None), (20_000, None, 30_000), (0, 0, 0)])
def test_without_experience_bytes_the_uplink_is_shared_by_rounds(sizes: tuple[int | None, ...]) -> None:
    assert meta_counts(stage(sizes), uplink(150_000), "maml-t1").uplink_bytes == 50_000  # 1 round of 3
    assert meta_counts(stage(sizes), uplink(150_000), "maml-t2").uplink_bytes == 100_000


def test_a_stage_cut_short_before_the_model_is_charged_as_far_as_it_got() -> None:
    rows = stage((20_000,))
    assert meta_counts(rows, uplink(44_000), "maml-t2").uplink_bytes == 44_000
    assert meta_rounds(rows, "maml-t2") == 1
    assert meta_counts([], uplink(7_000), "maml-t2") == Counts(uplink_bytes=7_000)


def test_each_meta_learning_method_has_a_stage_of_its_own() -> None:
    rows = stage((1, 1, 1)) + stage((1,), arm="reptile")
    assert meta_counts(rows, [], "reptile").gradients_support == 20
    assert meta_counts(rows, [], "fl") == meta_counts(rows, [], "anil") == Counts()
    assert (meta_rounds(rows, "reptile"), meta_rounds(rows, "fl"), meta_rounds(rows, "centralized")) == (1, 0, 0)


def test_tasks_of_an_arm_with_meta_learning_do_not_pay_for_its_downlink() -> None:
    meter = delivered("agent-1", topics.meta_model(RUN, "maml"), 5_000)
    meter += delivered("agent-2", topics.weights(RUN, "maml", 1, 1), 900, sender="agent-1")
    assert task_counts([], meter, "maml") == Counts(sidelink_bytes=900, sidelink_sent_bytes=900)


def test_a_parameter_servers_traffic_is_its_tasks() -> None:
    up, down = f"jouleswarm/{RUN}/fedavg/ul/2/3/weights", f"jouleswarm/{RUN}/fedavg/dl/2/average"
    meter = delivered("datacenter", up, 600) + delivered("agent-3", down, 700) + delivered("agent-4", down, 700)
    meter += delivered("datacenter", f"jouleswarm/{RUN}/fedavg/ul/1/1/weights", 100)
    meter += delivered("mosquitto_sub", down, 700)  # an onlooker
    rows = [row(arm="fedavg", task=2, agent=agent, round=1, gradients=20) for agent in (3, 4)]
    second = Counts(gradients_robots=40, uplink_bytes=600, downlink_bytes=1400)
    assert task_counts(rows, meter, "fedavg", task=2) == second
    assert task_counts(rows, meter, "fedavg", task=1) == Counts(uplink_bytes=100)
    assert task_counts(rows, meter, "fedavg") == second + Counts(uplink_bytes=100)


def test_a_task_whose_number_begins_like_anothers_is_another() -> None:
    meter = delivered("datacenter", f"jouleswarm/{RUN}/fedavg/ul/12/3/weights", 600)
    assert task_counts([], meter, "fedavg", task=1) == Counts()


def test_centralized_learning_is_paid_by_the_data_center_in_its_tasks() -> None:
    up = delivered("datacenter", topics.transition(RUN, "centralized", 1, 1), 24_000)
    down = delivered("agent-1", f"jouleswarm/{RUN}/centralized/dl/1/weights", 5_000)
    rows = [row(arm="centralized", agent=0, round=1, gradients=40), row(arm="centralized", agent=1, round=1)]
    counts = task_counts(rows, up + down, "centralized")
    assert counts == Counts(gradients_support=40, uplink_bytes=24_000, downlink_bytes=5_000)
    assert meta_counts(rows, up + down, "centralized") == Counts()
    priced = bill(StageCounts(fl=counts), Energy())
    assert priced.fl.computing_datacenter_j == pytest.approx(788.24)  # 1.67 x 40 x 11.8 J
    assert priced.robots_j == pytest.approx(0.96)  # 192 kbit / 200 kb/J, sent by robots
    assert priced.datacenter_j == pytest.approx(788.44)  # and 40 kbit / 200 kb/J down
    assert priced.ml.total_j == 0


def test_the_rows_of_the_data_center_are_no_robots_results() -> None:
    rows = [row(arm="centralized", agent=0, round=9, gradients=40), row(arm="centralized", agent=1, round=2)]
    assert task_results(scenario("centralized"), rows, "centralized", [1])[0].rounds == 2


def test_isolated_robots_are_judged_each_by_its_own_end() -> None:
    rows = [
        row(arm="isolated", agent=1, round=3, cluster_reward=52.0, rmse_m=0.5),
        row(arm="isolated", agent=1, round=4, cluster_reward=54.0, rmse_m=0.3, learned=True),
        row(arm="isolated", agent=2, round=4, cluster_reward=20.0, rmse_m=2.0),
        row(arm="isolated", agent=2, round=10, cluster_reward=50.0, rmse_m=0.1, learned=True),
    ]
    (result,) = task_results(scenario("isolated"), rows, "isolated", [1])
    assert (result.rounds, result.robot_rounds, result.learned) == (10, 14, True)
    assert result.reward == pytest.approx(52.0)  # (54 + 50) / 2
    assert result.rmse_m == pytest.approx(0.2)  # (0.3 + 0.1) / 2


@pytest.mark.parametrize("other", ["failed", "unfinished", "missing"])
def test_an_isolated_task_is_learned_by_all_of_its_robots_or_not(other: str) -> None:
    rows = [row(arm="isolated", agent=1, round=4, cluster_reward=54.0, learned=True)]
    if other != "missing":
        learned = False if other == "failed" else None
        rows.append(row(arm="isolated", agent=2, round=6, cluster_reward=10.0, learned=learned))
    (result,) = task_results(scenario("isolated"), rows, "isolated", [1])
    assert not result.learned


def test_a_robot_cut_off_behind_its_cluster_says_nothing_about_the_end() -> None:
    rows = [
        row(arm="fl", agent=1, round=5, cluster_reward=51.0, rmse_m=0.2, learned=True),
        row(arm="fl", agent=2, round=4, cluster_reward=30.0, rmse_m=3.0),
    ]
    (result,) = task_results(scenario("fl"), rows, "fl", [1])
    assert (result.rounds, result.reward, result.rmse_m, result.learned) == (5, 51.0, 0.2, True)


def test_summary_by_cause_and_site() -> None:
    found = scenario("centralized", energy={"datacenter_g_per_kwh": 360.0, "robots_g_per_kwh": 36.0})
    rows = [row(arm="centralized", agent=0, round=1, gradients=40), row(arm="centralized", agent=1, round=1)]
    meter = delivered("datacenter", topics.transition(RUN, "centralized", 1, 1), 24_000)
    meter += delivered("agent-1", f"jouleswarm/{RUN}/centralized/dl/1/weights", 5_000)
    arm = summarise(found, rows, meter)["arms"]["centralized"]
    assert (arm["method"], arm["t0"]) == ("centralized", 0)
    assert arm["counts"]["fl"]["uplink_bytes"] == 24_000
    assert arm["energy_j"]["by_cause"] == pytest.approx(
        {"computing_datacenter": 788.24, "computing_robots": 0, "uplink": 0.96, "downlink": 0.2, "sidelink": 0}
    )
    assert arm["energy_j"]["by_site"] == pytest.approx({"datacenter": 788.44, "robots": 0.96})
    # at 360 g/kWh a joule is 0.0001 g
    assert arm["carbon_g"] == pytest.approx({"datacenter": 0.078844, "robots": 0.0000096, "total": 0.0788536})
    assert arm["energy_j"]["published"] is None  # the paper prints nothing of this method


def test_unmetered_sites_are_unknown_in_the_summary() -> None:
    found = scenario("fl", energy={"robots_g_per_kwh": 36.0})
    arm = summarise(found, [row(arm="fl", agent=1, round=1, gradients=20)], [])["arms"]["fl"]
    assert arm["energy_j"]["by_cause"]["computing_robots"] == pytest.approx(40.8)
    assert arm["energy_j"]["by_cause"]["sidelink"] is None
    assert arm["energy_j"]["by_site"] == {"datacenter": None, "robots": None}
    assert arm["carbon_g"] == {"datacenter": None, "robots": None, "total": None}


def test_a_summary_without_intensities_has_no_grams() -> None:
    assert summarise(scenario("fl"), [], [])["arms"]["fl"]["carbon_g"] is None


def test_a_summary_has_every_arm_with_its_own_t0() -> None:
    found = summarise(scenario("maml", "fl", "reptile"), stage((1, 1, 1)), [])
    assert {arm: held["t0"] for arm, held in found["arms"].items()} == {
        "maml-t1": 1, "maml": 3, "fl": 0, "reptile-t1": 0, "reptile": 0,
    }  # fmt: skip
    assert found["t0"] == 3
