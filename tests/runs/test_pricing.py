"""The bill of the made-up run of tests/made_up_run.py, worked out by hand."""

import json

import pytest

from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.topics import Link, weights
from jouleswarm.energy.facts import Counts, StageCounts
from jouleswarm.runs.arm_facts import arm_facts, in_packets
from jouleswarm.runs.facts import TaskResult, meta_rounds, task_counts, task_results
from jouleswarm.runs.summary import summarise
from jouleswarm.runs.traffic import Traffic, metered_by, traffic

LITERAL_MAML = {
    "ml_learning": 2364.72,  # 1.67 x (3 rounds x 2 tasks x 20 gradients) x 11.8 J
    "ml_communication": 5.6,  # up 120,000 B x 8 / 200 kb/J = 4.8 J, down 4 x 5000 B x 8 / 200 kb/J = 0.8 J
    "fl_learning": 816.0,  # (4 + 6) rounds x 2 robots x 20 gradients x 2.04 J
    "fl_communication": 1.6,  # (4 + 6) rounds x 2 links x 5000 B x 8 / 500 kb/J
    "total": 3187.92,
}
LITERAL_NO_MAML = {
    "ml_learning": 0.0,
    "ml_communication": 0.0,
    "fl_learning": 2448.0,  # (10 + 20) x 2 x 20 x 2.04 J
    "fl_communication": 4.8,  # 30 x 2 x 5000 B x 8 / 500 kb/J
    "total": 2452.8,
}


def test_counts_of_an_arm(facts) -> None:
    assert arm_facts(facts.scenario, facts.rows, facts.meter_rows, "maml").counts == StageCounts(
        ml=Counts(gradients_support=60, gradients_query=60, uplink_bytes=120_000, downlink_bytes=20_000),
        fl=Counts(gradients_robots=400, sidelink_bytes=100_000, sidelink_sent_bytes=100_000),
    )


def test_counts_of_one_task_leave_out_what_serves_all(facts) -> None:
    assert task_counts(facts.rows, facts.meter_rows, "maml", task=2) == Counts(
        gradients_robots=240, sidelink_bytes=60_000, sidelink_sent_bytes=60_000
    )


def test_counts_in_whole_packets(facts) -> None:
    of_run = facts.scenario, facts.rows, facts.meter_rows
    packets = in_packets(arm_facts(*of_run, "maml"), *of_run).counts
    assert (packets.ml.uplink_bytes, packets.ml.downlink_bytes) == (132_000, 20_200)
    assert packets.fl.sidelink_bytes == 20 * 5040


def test_tasks_add_up_to_their_arm(facts) -> None:
    per_task = [task_counts(facts.rows, facts.meter_rows, "fl", task=task) for task in (1, 2)]
    assert per_task[0] + per_task[1] == task_counts(facts.rows, facts.meter_rows, "fl")


def test_an_onlookers_copies_are_not_counted(facts) -> None:
    assert traffic(facts.meter_rows, "maml", Link.SIDELINK) == Traffic(20, 100_000, 100_800)
    # meta_round to 4 robots, one telemetry message to the recorder
    assert traffic(facts.meter_rows, "maml", Link.CONTROL) == Traffic(5, 700, 950)


def test_overhead_is_protocol_bytes_per_payload_byte() -> None:
    assert Traffic(1, 1000, 1100).overhead == pytest.approx(0.1)
    assert Traffic().overhead is None


def test_without_broker_rows_the_clients_feed_the_same_bill(facts) -> None:
    external = [row for row in facts.meter_rows if row.side == "client"]
    assert metered_by(external) == "client"
    found = [arm_facts(facts.scenario, facts.rows, rows, "maml") for rows in (external, facts.meter_rows)]
    assert found[0].counts == found[1].counts


def test_a_message_to_many_neighbours_is_sent_once(facts) -> None:
    meter, topic = Meter("broker"), weights("r", "maml", 1, 1)
    meter.count("agent-1", topic, "in", 10, 20)
    for neighbour in (2, 3, 4):
        meter.count(f"agent-{neighbour}", topic, "out", 10, 20)
    found = task_counts([], meter.rows(), "maml")
    assert (found.sidelink_sent_bytes, found.sidelink_bytes) == (10, 30)


def test_rounds_and_rewards_of_each_task(facts) -> None:
    assert (meta_rounds(facts.rows, "maml"), meta_rounds(facts.rows, "fl")) == (3, 0)
    assert task_results(facts.scenario, facts.rows, "maml") == [
        TaskResult(1, 4, 55.0, 1.25, learned=True, robot_rounds=8, partial_window=4),  # before R's window is full
        TaskResult(2, 6, 55.0, 1.25, learned=True, robot_rounds=12, full_window=6, partial_window=6),
    ]
    assert task_results(facts.scenario, facts.rows, "fl", [2]) == [
        TaskResult(task=2, rounds=20, reward=-20.0, rmse_m=1.25, learned=False, robot_rounds=40)
    ]


def test_a_task_without_rows_was_not_learned(facts) -> None:
    assert task_results(facts.scenario, [], "maml", [1]) == [TaskResult(1, 0, None, None, False, 0)]


def test_a_run_cut_before_its_last_row_is_judged_by_its_reward_and_window(facts) -> None:
    cut = [row.model_copy(update={"learned": None}) for row in facts.rows]
    assert [result.learned for result in task_results(facts.scenario, cut, "maml")] == [False, True]
    assert [result.learned for result in task_results(facts.scenario, cut, "fl")] == [True, False]


def test_summary(facts) -> None:
    summary = summarise(facts.scenario, facts.rows, facts.meter_rows)
    assert (summary["seed"], summary["t0"], summary["status"], summary["metered_by"]) == (
        7, 3, "complete", "broker",
    )  # fmt: skip
    maml, fl = summary["arms"]["maml"], summary["arms"]["fl"]
    assert maml["energy_j"]["literal"] == pytest.approx(LITERAL_MAML)
    assert fl["energy_j"]["literal"] == pytest.approx(LITERAL_NO_MAML)
    assert maml["tasks"][0] == {
        "task": 1, "rounds": 4, "reward": 55.0, "rmse_m": 1.25, "learned": True, "robot_rounds": 8,
        "full_window": None, "partial_window": 4, "missed_exits": None, "episodes": 0,
    }  # fmt: skip
    assert (maml["zero_shot_share"], fl["zero_shot_share"]) == (0.0, 0.0)
    assert maml["bytes"]["uplink"] == {"messages": 120, "payload": 120_000, "packet": 132_000}
    assert maml["bytes"]["downlink"] == {"messages": 4, "payload": 20_000, "packet": 20_200}
    assert fl["bytes"]["uplink"] == {"messages": 0, "payload": 0, "packet": 0}
    assert summary["shared_control"] == {"messages": 2, "payload": 80, "packet": 180}
    assert json.loads(json.dumps(summary)) == summary


def three_tasks(scenario: Scenario) -> Scenario:
    """With a third training robot, as the paper has."""
    data = scenario.model_dump(mode="json")
    data["tasks"].append({"id": 3, "map": "E . \n * . \n X ."})
    return scenario_from({**data, "meta": {**data["meta"], "training_tasks": [1, 2, 3]}}, "three")


def test_published_totals_have_no_parts(facts) -> None:
    summary = summarise(three_tasks(facts.scenario), facts.rows, facts.meter_rows, [1, 2])
    published = {arm: summary["arms"][arm]["energy_j"]["published"] for arm in ("maml", "fl")}
    nothing = {"ml_learning": None, "ml_communication": None, "fl_learning": None, "fl_communication": None}
    # 3 x 352.4 J + 10 x 246.3 J, and 30 x 246.3 J
    assert published["maml"] == {**nothing, "total": pytest.approx(3520.2)}
    assert published["fl"] == {
        **nothing, "ml_learning": 0.0, "ml_communication": 0.0, "total": pytest.approx(7389.0),
    }  # fmt: skip


def test_published_is_null_at_other_efficiencies(facts) -> None:
    energy = facts.scenario.energy.model_copy(update={"sl_bit_per_j": 200e3})
    scenario = three_tasks(facts.scenario).model_copy(update={"energy": energy})
    summary = summarise(scenario, facts.rows, facts.meter_rows)
    assert summary["arms"]["maml"]["energy_j"]["published"] is None


def test_published_is_null_in_another_deployment(facts) -> None:
    summary = summarise(facts.scenario, facts.rows, facts.meter_rows)  # two training robots
    assert [summary["arms"][arm]["energy_j"]["published"] for arm in ("maml", "fl")] == [None, None]


def test_unmetered_communication_is_unknown_and_not_free(facts) -> None:
    summary = summarise(facts.scenario, facts.rows, [], status="interrupted")
    literal = summary["arms"]["maml"]["energy_j"]["literal"]
    assert (summary["status"], summary["metered_by"]) == ("interrupted", None)
    assert literal["ml_learning"] == pytest.approx(2364.72)
    assert (literal["ml_communication"], literal["fl_communication"], literal["total"]) == (None, None, None)
