"""The whole path as a user takes it: `jouleswarm run scenarios/toy.toml`, and what it leaves behind."""

import datetime
import itertools
import re
from collections import Counter
from typing import Any

import numpy as np
import pytest
import safetensors

from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.learning.heads import head_of, meta_shapes
from jouleswarm.learning.networks import build_qnetwork, shapes_of

ARMS = ("maml", "fl")
LINKS = {"uplink", "downlink", "sidelink", "control"}
PARTS = {"ml_learning", "ml_communication", "fl_learning", "fl_communication", "total"}


def test_the_answer_and_what_to_type_next_are_printed(toy_run: Any) -> None:
    told = toy_run.summary["answer"]
    (held,) = told["against"]
    assert held["factor"] == told["arms"]["maml"]["total_j"] / told["arms"]["fl"]["total_j"] > 1
    assert f"MAML costs {held['factor']:.2g} times as much as FL, no transfer: " in toy_run.printed
    assert "toy only shows that all works" in toy_run.printed
    assert "Bytes delivered by link class" not in toy_run.printed  # asked for by --details
    assert f"report {toy_run.path} --details\n" in toy_run.printed


def test_the_manifest_says_what_was_run_where(toy_run: Any) -> None:
    manifest = toy_run.manifest
    assert (manifest["schema"], manifest["run"], manifest["seed"]) == (2, "toy", 1)
    scenario = scenario_from(manifest["scenario"], "manifest")
    assert (scenario.name, len(scenario.agents), scenario.meta.t0) == ("toy", 4, 3)
    assert {"python", "jouleswarm", "torch", "amqtt", "paho-mqtt"} <= set(manifest["versions"])
    assert {"system", "machine", "cores"} <= set(manifest["host"])
    assert manifest["broker"]["embedded"] is True


def test_there_is_one_row_a_robot_and_round(toy_run: Any) -> None:
    rows = [RoundRow.model_validate(row) for row in toy_run.lines("rounds.jsonl")]
    assert [row.sort_key() for row in rows] == sorted({row.sort_key() for row in rows})
    center = [row for row in rows if row.agent == 0]
    assert [(row.phase, row.task, row.round) for row in center] == [("maml", 1, 1), ("maml", 1, 2), ("maml", 1, 3)]
    for arm in ARMS:
        last: dict[int, set[int]] = {}
        for agent, task in ((1, 1), (2, 1), (3, 2), (4, 2)):
            mine = [row for row in rows if (row.phase, row.arm, row.agent) == ("fl", arm, agent)]
            assert {row.task for row in mine} == {task}
            assert [row.round for row in mine] == list(range(len(mine)))
            assert [row.learned is None for row in mine] == [True] * (len(mine) - 1) + [False]
            assert all(row.reward is not None and row.rmse_m is not None for row in mine)
            assert [row.gradients for row in mine] == [0] + [10] * (len(mine) - 1)  # none in round 0
            last.setdefault(task, set()).add(len(mine))
        assert all(len(rounds) == 1 for rounds in last.values())  # a cluster ends in one round


def test_meter_rows_are_final_and_each_there_once(toy_run: Any) -> None:
    rows = [MeterRow.model_validate(row) for row in toy_run.lines("meter.jsonl")]
    keys = Counter((row.side, row.topic, row.client, row.direction) for row in rows)
    assert set(keys.values()) == {1}
    assert {row.side for row in rows} == {"broker", "client"}
    assert {row.arm for row in rows} == {"maml", "fl", "all"}
    assert {row.client for row in rows} == {"datacenter", "recorder", "agent-1", "agent-2", "agent-3", "agent-4"}
    assert all(row.packet_bytes > row.payload_bytes for row in rows)
    assert all(row.topic.startswith("jouleswarm/toy/") for row in rows)


def test_the_summary_holds_rounds_joules_and_bytes_of_each_arm(toy_run: Any) -> None:
    summary = toy_run.summary
    assert (summary["seed"], summary["t0"]) == (1, 3)
    assert (summary["status"], summary["metered_by"]) == ("complete", "broker")
    assert (summary["counters"], summary["counters_fit"]) == ("the broker's counters, from the run's beginning", True)
    assert set(summary["arms"]) == set(ARMS)
    for arm in ARMS:
        part = summary["arms"][arm]
        assert [set(task) for task in part["tasks"]] == [
            {"task", "rounds", "robot_rounds", "reward", "rmse_m", "learned"}
            | {"full_window", "partial_window", "missed_exits", "episodes"}
        ] * 2
        assert [task["task"] for task in part["tasks"]] == [1, 2]
        assert set(part["energy_j"]) == {"literal", "published", "by_cause", "by_site"}
        assert set(part["energy_j"]["literal"]) == PARTS
        assert part["energy_j"]["published"] is None  # not the paper's deployment
        assert set(part["bytes"]) == LINKS
        assert all(set(part["bytes"][link]) == {"messages", "payload", "packet"} for link in LINKS)


def test_the_summarys_rounds_are_those_of_the_rows(toy_run: Any) -> None:
    rows = toy_run.lines("rounds.jsonl")
    for arm in ARMS:
        for task in toy_run.summary["arms"][arm]["tasks"]:
            mine = [row for row in rows if (row["phase"], row["arm"], row["task"]) == ("fl", arm, task["task"])]
            assert task["rounds"] == max(row["round"] for row in mine)
            (reward,) = {row["cluster_reward"] for row in mine if row["round"] == task["rounds"]}
            assert task["reward"] == pytest.approx(reward)
            assert task["learned"] == (reward >= 50)


def test_the_literal_bill_follows_from_rounds_and_bytes_by_hand(toy_run: Any) -> None:
    summary = toy_run.summary
    for arm in ARMS:
        part = summary["arms"][arm]
        rounds = sum(task["rounds"] for task in part["tasks"])
        moved = part["bytes"]
        bill = part["energy_j"]["literal"]
        # 2 robots a task, 10 gradients a round, 5.1 W x 0.4 s each
        assert bill["fl_learning"] == pytest.approx(rounds * 2 * 10 * 5.1 * 0.4)
        assert bill["fl_communication"] == pytest.approx(moved["sidelink"]["payload"] * 8 / 500e3)
        # t0 = 3, one training robot's 4 + 4 gradients: 1.67 x 590 W x 0.02 s each; downlink at the uplink's price
        assert bill["ml_learning"] == pytest.approx(3 * 8 * 1.67 * 590 * 0.02 if arm == "maml" else 0)
        up_and_down = moved["uplink"]["payload"] + moved["downlink"]["payload"]
        assert bill["ml_communication"] == pytest.approx(up_and_down * 8 / 200e3)
        assert bill["total"] == pytest.approx(sum(bill[name] for name in PARTS - {"total"}))


def test_payload_messages_are_rounds_times_directed_links(toy_run: Any) -> None:
    arms = toy_run.summary["arms"]
    for arm in ARMS:
        rounds = sum(task["rounds"] for task in arms[arm]["tasks"])
        assert arms[arm]["bytes"]["sidelink"]["messages"] == 2 * rounds
    assert arms["maml"]["bytes"]["uplink"]["messages"] == 3 * 10  # t0 x motions
    assert arms["maml"]["bytes"]["downlink"]["messages"] == 4  # robots
    assert arms["fl"]["bytes"]["uplink"]["messages"] == arms["fl"]["bytes"]["downlink"]["messages"] == 0


def test_weights_of_every_task_and_the_meta_model_open_in_the_safetensors_library(toy_run: Any) -> None:
    files = {path.stem for path in (toy_run.path / "weights").iterdir()}
    assert files == {f"{arm}-task{task}" for arm in ARMS for task in (1, 2)} | {"maml-meta-t0003"}
    scenario = scenario_from(toy_run.manifest["scenario"], "manifest")
    network = build_qnetwork(scenario)
    learned = shapes_of(network)
    meta = meta_shapes(learned, head_of(network), scenario.meta.training_tasks)
    for name in files:
        with safetensors.safe_open(toy_run.path / "weights" / f"{name}.safetensors", framework="np") as file:
            assert {key: file.get_tensor(key).shape for key in file.keys()} == (  # noqa: SIM118
                learned if "task" in name else meta
            )
            assert all(np.isfinite(file.get_tensor(key)).all() for key in file.keys())  # noqa: SIM118
            metadata = file.metadata()
        assert metadata["task"] == (name[-1] if "task" in name else "0")


def test_figures_and_a_report_that_needs_no_network_are_drawn(toy_run: Any) -> None:
    drawn = {path.name for path in (toy_run.path / "figures").iterdir()}
    names = ("energy", "rounds", "rewards", "learned", "why", "bytes")
    assert drawn - {"learned.csv", "paths.json"} == {f"{name}.{kind}" for name in names for kind in ("png", "svg")}
    html = (toy_run.path / "report.html").read_text()
    assert "FL, no transfer" in html
    assert not re.search(r"""(src|href)=["'](https?:)?//""", html)
    # both tasks were learned in both arms: four greedy paths, kept beside the figures
    assert html.count("<polyline") == 4
    assert (toy_run.path / "figures" / "paths.json").is_file()


def test_a_run_that_is_complete_has_nothing_left_to_go_on_from(toy_run: Any) -> None:
    names = {path.name for path in toy_run.path.iterdir()}
    files = {"manifest.json", "summary.json", "report.html"}
    rows = {f"{name}.jsonl" for name in ("rounds", "meter", "work", "progress", "times")}
    assert names == files | rows | {"weights", "figures", "logs"}


def test_undisturbed_every_gradient_and_motion_that_was_done_is_in_a_row(toy_run: Any) -> None:
    done = {(row["client"], row["phase"], row["arm"]): row for row in toy_run.lines("work.jsonl")}
    rows = toy_run.lines("rounds.jsonl")
    for (client, phase, arm), work in done.items():
        agent = 0 if client == "datacenter" else int(client.removeprefix("agent-"))
        mine = [row for row in rows if (row["agent"], row["phase"], row["arm"]) == (agent, phase, arm)]
        assert work["gradients"] + work["gradients_query"] == sum(row["gradients"] for row in mine)
        assert work["motions"] == sum(row["motions"] or 0 for row in mine)
        assert work["motions"] == (10 * sum(row["round"] > 0 for row in mine) if agent else 0)  # motions_per_round
        assert work["evaluation_motions"] == sum(row["evaluation_motions"] or 0 for row in mine)
    assert {(row["agent"], row["phase"], row["arm"]) for row in rows} == {
        (0 if client == "datacenter" else int(client.removeprefix("agent-")), phase, arm) for client, phase, arm in done
    }
    assert not any("lost_work" in arm for arm in toy_run.summary["arms"].values())


def test_progress_only_grows(toy_run: Any) -> None:
    rows = toy_run.lines("progress.jsonl")
    assert rows
    for before, after in itertools.pairwise(rows):
        assert after["time_s"] > before["time_s"]
        assert all(after["bytes"][link] >= before["bytes"][link] for link in LINKS)


def test_each_row_has_a_time_and_ended_after_the_run_began(toy_run: Any) -> None:
    def whose(row: dict[str, Any]) -> tuple[Any, ...]:
        return tuple(row[key] for key in ("phase", "arm", "task", "agent", "round"))

    times = toy_run.lines("times.jsonl")
    assert sorted(map(whose, times)) == sorted(map(whose, toy_run.lines("rounds.jsonl")))
    started = datetime.datetime.fromisoformat(toy_run.manifest["started"]).timestamp()
    assert all(started < row["time_s"] < started + 600 for row in times)


def test_a_finished_run_is_priced_again_and_stays_as_it_is(toy_run: Any, start: Any) -> None:
    def content() -> dict[str, bytes]:
        return {str(path): path.read_bytes() for path in toy_run.path.rglob("*") if path.is_file()}

    before = content()
    report = start.jouleswarm("report", str(toy_run.path), "--ul", "500", "--sl", "200", "--details")
    assert report.ends() == 0, report.printed
    assert "E_UL 500, E_DL 500, E_SL 200 kb/J" in report.printed
    assert content() == before


def test_without_a_terminal_a_run_says_at_once_what_it_waits_for_and_its_logs_stay_small(toy_run: Any) -> None:
    told = [line for line in toy_run.printed.splitlines() if " | starting " in line]
    assert told[0].endswith("0 s | starting 4 robots and the data center: 0 of 5 here")
    assert toy_run.printed.count("a line every 10 s: ") == 1
    assert not [log for log in (toy_run.path / "logs").glob("*.log") if "own reward" in log.read_text()]
