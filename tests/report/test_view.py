"""The live view: where the clusters stand and what it has cost, as text."""

import io
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from jouleswarm.common.bus.bus import MemoryHub
from jouleswarm.common.bus.reporter import Telemetry
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import encode_json
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.energy.bill import Bill, Cost
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.literal import literal
from jouleswarm.fleet.recorder import Recorder
from jouleswarm.report import view as module
from jouleswarm.report.view import View
from jouleswarm.runs.directory import RunDirectory

RUN = "r"


@pytest.fixture
def scenario() -> Scenario:
    return scenario_from(
        {
            "name": "made-up", "seed": 4, "world": {"rows": 3, "cols": 2}, "meta": {"t0": 5, "training_tasks": [1]},
            "tasks": [{"id": task, "map": "E . \n * . \n X ."} for task in (1, 2)],
        },
        "test",
    )  # fmt: skip


@pytest.fixture
def recorder(scenario: Scenario, tmp_path: Path) -> Recorder:
    """After 3 of 5 MAML rounds, cluster 1 learned in round 7, cluster 2 at round 2 (robot 4: 3)."""
    hub = MemoryHub()
    recorder = Recorder(hub.connect("recorder"), scenario, RUN, RunDirectory(tmp_path / "run"))
    robots = hub.connect("robots")

    def say(client: str, received: int, **fields: Any) -> None:
        row = RoundRow.model_validate({"arm": "maml", "seconds": 0.1, **fields})
        told = {"uplink": 2 * received, "downlink": 0, "sidelink": received, "control": 10}
        robots.publish(topics.telemetry(RUN, "maml", client), encode_json(Telemetry(row=row, received=told)))

    say("datacenter", 0, phase="maml", task=1, agent=0, round=3)
    for agent in (1, 2):
        say(f"agent-{agent}", 500_000, phase="fl", task=1, agent=agent, round=7, cluster_reward=51.26, learned=True)
    say("agent-3", 250_000, phase="fl", task=2, agent=3, round=2, cluster_reward=-4.0)
    say("agent-4", 250_000, phase="fl", task=2, agent=4, round=3, cluster_reward=-4.0)
    recorder.pump(0.05)
    return recorder


def shown(view: View, width: int = 100) -> str:
    console = Console(file=io.StringIO(), width=width)
    console.print(view.render())
    return console.file.getvalue()  # type: ignore[attr-defined]


def line_with(text: str, *words: str) -> list[str]:
    (line,) = (line for line in text.splitlines() if all(word in line for word in words))
    return line.split()


def test_phase_round_and_reward_of_each_cluster_are_shown(scenario: Scenario, recorder: Recorder) -> None:
    text = shown(View(Console(file=io.StringIO()), scenario, recorder))
    assert "made-up, seed 4" in text
    assert "3/5" in line_with(text, "MAML", "all")
    assert line_with(text, "MAML, t0 = 5", "learned")[-4:] == ["1", "7", "51.3", "learned"]
    assert line_with(text, "MAML, t0 = 5", "-4.0")[4:7] == ["2", "2", "-4.0"]  # the slower of its two robots
    assert "FL, no transfer" not in text  # nothing of that arm yet


def test_bytes_and_joules_of_each_link_are_shown(scenario: Scenario, recorder: Recorder) -> None:
    text = shown(View(Console(file=io.StringIO()), scenario, recorder))
    # uplink 3 MB x 8 / 200 kb/J = 120 J; sidelink 1.5 MB x 8 / 500 kb/J = 24 J
    assert line_with(text, "uplink") == ["uplink", "3.0", "120"]
    assert line_with(text, "sidelink") == ["sidelink", "1.5", "24"]
    assert line_with(text, "control") == ["control", "0.0", "not", "priced"]


def test_the_line_for_logs_says_the_same_in_short(scenario: Scenario, recorder: Recorder) -> None:
    line = View(Console(file=io.StringIO()), scenario, recorder).line()
    assert "MAML 3/5" in line
    assert "maml 1:7+(51) 2:2(-4)" in line
    assert "uplink 3.0 MB sidelink 1.5 MB" in line


def test_who_waits_for_whom_is_shown_the_longest_first(
    scenario: Scenario, recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits = [f"agent-{agent} waits for round 8 of robots [5] ({90 - agent} s)" for agent in (1, 2, 3, 4)]
    monkeypatch.setattr(Recorder, "waits", property(lambda self: waits))
    view = View(Console(file=io.StringIO()), scenario, recorder)
    assert view.line().endswith(" | ".join([*waits[:3], "and 1 more wait"]))
    assert all(wait in shown(view) for wait in waits[:3])


def test_on_a_pipe_a_line_is_printed_now_and_then(
    scenario: Scenario, recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = io.StringIO()
    with View(Console(file=output, width=200), scenario, recorder) as view:
        view.update()
        assert output.getvalue() == ""  # not at once
        monkeypatch.setattr(module, "_LINE_EVERY_S", 0.0)
        view.update()
    assert len(output.getvalue().splitlines()) == 1


def test_on_a_terminal_the_view_is_live_and_gone_at_the_end(scenario: Scenario, recorder: Recorder) -> None:
    output = io.StringIO()
    with View(Console(file=output, width=100, force_terminal=True), scenario, recorder) as view:
        view.update()
    assert "51.3" in output.getvalue()
    assert output.getvalue().endswith("\x1b[2K")  # its last lines are erased


def test_an_empty_recorder_is_shown_too(scenario: Scenario, tmp_path: Path) -> None:
    recorder = Recorder(MemoryHub().connect("recorder"), scenario, RUN, RunDirectory(tmp_path / "run"))
    view = View(Console(file=io.StringIO()), scenario, recorder)
    assert "0/5" in shown(view)
    assert "MAML 0/5" in view.line()


def test_the_data_centers_stage_is_shown_of_every_meta_learning_method(scenario: Scenario, tmp_path: Path) -> None:
    scenario = scenario_from(scenario.model_dump() | {"methods": ["fl", "reptile", "centralized", "maml"]}, "test")
    hub = MemoryHub()
    recorder = Recorder(hub.connect("recorder"), scenario, RUN, RunDirectory(tmp_path / "methods"))
    center = hub.connect("datacenter")
    for arm, phase, round_ in (("reptile", "maml", 4), ("centralized", "fl", 9)):
        row = RoundRow.model_validate(
            {"phase": phase, "arm": arm, "task": 1, "agent": 0, "round": round_, "seconds": 0.1}
        )
        told = encode_json(Telemetry(row=row, received={}))
        center.publish(topics.telemetry(RUN, arm, "datacenter"), told)
    recorder.pump(0.05)
    view = View(Console(file=io.StringIO()), scenario, recorder)
    assert "4/5" in line_with(shown(view), "data center: Reptile", "all")
    assert "0/5" in line_with(shown(view), "data center: MAML", "all")
    assert "Reptile 4/5 | MAML 0/5" in view.line()
    assert "9/5" not in shown(view)  # no stage before the tasks: it serves their rounds


@pytest.fixture
def isolated(scenario: Scenario, tmp_path: Path) -> tuple[Scenario, Recorder, Any]:
    scenario = scenario_from(scenario.model_dump() | {"methods": ["isolated", "fl"]}, "test")
    hub = MemoryHub()
    recorder = Recorder(hub.connect("recorder"), scenario, RUN, RunDirectory(tmp_path / "isolated"))
    robots = hub.connect("robots")

    def say(agent: int, round_: int, learned: bool | None) -> None:
        row = RoundRow(
            phase="fl", arm="isolated", task=(agent + 1) // 2, agent=agent, round=round_, seconds=0.1,
            cluster_reward=10.0 * round_, learned=learned,
        )  # fmt: skip
        told = encode_json(Telemetry(row=row, received={}))
        robots.publish(topics.telemetry(RUN, "isolated", f"agent-{agent}"), told)
        recorder.pump(0.05)

    return scenario, recorder, say


def test_a_robot_that_is_done_does_not_hide_one_that_is_not(isolated: tuple[Scenario, Recorder, Any]) -> None:
    scenario, recorder, say = isolated
    say(1, 3, True)
    say(2, 4, None)
    text = shown(View(Console(file=io.StringIO()), scenario, recorder))
    assert line_with(text, "isolated robots")[2:5] == ["1", "4", "40.0"]
    assert "learned" not in text


def test_an_arm_that_is_over_is_one_row(isolated: tuple[Scenario, Recorder, Any]) -> None:
    scenario, recorder, say = isolated
    for agent, round_, learned in ((1, 3, True), (2, 7, True), (3, 20, False), (4, 5, True)):
        say(agent, round_, learned)
    view = View(Console(file=io.StringIO()), scenario, recorder)
    text = shown(view)
    assert "isolated done" in view.line()
    # the last robots stopped in rounds 7 and 20; robot 3 had not learned
    assert line_with(text, "isolated robots") == ["isolated", "robots", "all", "sum", "27", "1", "of", "2", "learned"]


def test_sidelinks_via_the_base_station_are_priced_at_the_end(scenario: Scenario, recorder: Recorder) -> None:
    energy = scenario.energy.model_copy(update={"sidelink": "via_base_station"})
    view = View(Console(file=io.StringIO()), scenario.model_copy(update={"energy": energy}), recorder)
    assert line_with(shown(view), "sidelink") == ["sidelink", "1.5", "at", "the", "end"]


class Twice:
    name, label = "twice", "twice"

    def price(self, facts: Facts, energy: Energy) -> Bill:
        once = literal.price(facts, energy)
        return once + once


class Fails:
    name, label = "fails", "of rounds"

    def price(self, facts: Facts, energy: Energy) -> Bill:
        return Bill(fl=Cost(uplink_j=1 / len(facts.rounds)))


def test_a_list_of_the_users_own_has_its_joules_so_far_where_bytes_tell_them(
    scenario: Scenario, recorder: Recorder
) -> None:
    here = "tests.report.test_view"
    prices = ("literal", "published", f"{here}:Twice", "examples.cellular:Cellular", f"{here}:Fails")
    energy = scenario.energy.model_copy(update={"prices": prices})
    view = View(Console(file=io.StringIO()), scenario.model_copy(update={"energy": energy}), recorder)
    text = shown(view, 200)
    heads = ["J so far", "J so far, twice", "J so far, cellular, 0.9 J a message", "J so far, of rounds"]
    (head,) = (line for line in text.splitlines() if "received over" in line)
    assert [each for each in heads if each not in head] == []
    # 3 MB x 8 / 200 kb/J; a view knows neither messages nor rounds
    at_the_end = ["at", "the", "end"]
    assert line_with(text, "uplink") == ["uplink", "3.0", "120", "240", *at_the_end, *at_the_end]
