"""The live view: what a run does now, where the clusters stand and what it has cost, as text."""

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
from jouleswarm.common.wire.messages import Presence, encode_json
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


def seen(scenario: Scenario, recorder: Recorder, width: int = 100, height: int = 50) -> View:
    """A view of a terminal of that size, that has looked once."""
    view = View(Console(file=io.StringIO(), width=width, height=height), scenario, recorder)
    view.update()
    return view


def shown(view: View, width: int = 100) -> str:
    console = Console(file=io.StringIO(), width=width)
    console.print(view.render())
    return console.file.getvalue()  # type: ignore[attr-defined]


def line_with(text: str, *words: str) -> list[str]:
    (line,) = (line for line in text.splitlines() if all(word in line for word in words))
    return line.split()


def test_phase_round_and_reward_of_each_cluster_are_shown(scenario: Scenario, recorder: Recorder) -> None:
    text = shown(seen(scenario, recorder))
    assert "made-up, seed 4" in text
    # Both robots of the training task are further, in these made-up rows.
    assert "MAML in the data center: 3 of 5 rounds; experience of round 4: the data center learns from it" in text
    assert line_with(text, "MAML, t0 = 5") == [
        "MAML,",
        "t0",
        "=",
        "5",
        "1",
        "of",
        "2",
        "learned,",
        "round",
        "2",
        "to",
        "7",
    ]
    assert line_with(text, "51.3") == ["1", "MAML", "7", "51.3", "learned"]
    assert line_with(text, "2 ", "-4.0")[:4] == ["2", "MAML", "2", "-4.0"]  # the slower of its two robots
    assert line_with(text, "FL, no transfer", "to come")


def test_joules_by_cause_and_in_total_are_shown_as_in_the_bill(scenario: Scenario, recorder: Recorder) -> None:
    text = shown(seen(scenario, recorder))
    # uplink 3 MB x 8 / 200 kb/J = 120 J; sidelinks 1.5 MB x 8 / 500 kb/J = 24 J; gradients in the last test of these
    assert line_with(text, "uplink ", " J") == ["uplink", "120", "J", "0", "J", "120", "J"]
    assert line_with(text, "sidelinks") == ["sidelinks", "24", "J", "0", "J", "24", "J"]
    assert line_with(text, "energy") == ["energy", "144", "J", "0", "J", "144", "J"]
    assert "received: uplink 3 MB, downlink 0 B, sidelink 1.5 MB" in text


def test_the_line_for_logs_says_the_same_in_short(scenario: Scenario, recorder: Recorder) -> None:
    parts = seen(scenario, recorder).line().split(" | ")
    assert parts[1].startswith("MAML in the data center: 3 of 5 rounds")
    # 120 of 144 J
    assert parts[2:] == ["R 1:51+ 2:-4", "144 J, 83% uplink", "time left unknown"]


def test_who_waits_for_whom_is_shown_the_longest_first(
    scenario: Scenario, recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits = [
        "agent-1 waits for round 8 of robots [5] (90 s)", "datacenter waits for round 4 of robots [1] (80 s)",
        "agent-3 waits for the meta-model (70 s)", "nothing heard of agent-2 (60 s)",
        "agent-4 waits for the meta-model (50 s)",
    ]  # fmt: skip
    monkeypatch.setattr(Recorder, "waits", property(lambda self: waits))
    view = seen(scenario, recorder)
    told = [
        "robot 1 waits for round 8 of robots [5] (90 s)", "data center waits for round 4 of robots [1] (80 s)",
        "2 processes wait for the meta-model (70 s)", "nothing heard of agent-2 (60 s)",
    ]  # fmt: skip
    assert view.line().endswith(f" | {told[0]}")
    assert [line for line in shown(view).splitlines() if line in told] == told
    low = shown(seen(scenario, recorder, height=12))
    assert [wait in low for wait in told] == [True, True, False, False]


def test_a_low_terminal_has_the_most_important_and_a_high_one_each_robot_too(
    scenario: Scenario, recorder: Recorder
) -> None:
    low, high = (shown(seen(scenario, recorder, height=height)) for height in (12, 50))
    # 11 lines: title 1, phase 1, clusters 3, joules 4; arms (3) do not fit any more, what was received (1) does
    assert len(low.splitlines()) == 10
    assert "51.3" in low
    assert "energy" in low
    assert "its own reward" not in low
    assert [line.split()[0] for line in high.splitlines()[-5:]] == ["robot", "1", "2", "3", "4"]


@pytest.mark.parametrize("width", [60, 80])
def test_nothing_is_cut_on_a_narrow_terminal(scenario: Scenario, recorder: Recorder, width: int) -> None:
    text = shown(seen(scenario, recorder, width), width)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    assert all(word in text for word in ("learned", "51.3", "144 J", "120 J", "24 J", "received", "transfer"))


def test_on_a_pipe_a_legend_and_a_first_line_come_at_once_and_then_a_line_now_and_then(
    scenario: Scenario, recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = io.StringIO()
    with View(Console(file=output, width=80), scenario, recorder) as view:
        view.update()
        legend, first = output.getvalue().splitlines()
        assert legend.startswith("a line every 10 s: seconds | what is done | R of each task, learned from 50 on")
        assert "3 of 5 rounds" in first
        monkeypatch.setattr(module, "_LINE_EVERY_S", 0.0)
        view.update()
    assert len(output.getvalue().splitlines()) == 3


def test_on_a_terminal_the_view_is_live_and_gone_at_the_end(scenario: Scenario, recorder: Recorder) -> None:
    output = io.StringIO()
    with View(Console(file=output, width=100, height=40, force_terminal=True), scenario, recorder) as view:
        view.update()
    assert "51.3" in output.getvalue()
    assert output.getvalue().endswith("\x1b[2K")  # its last lines are erased


def test_who_is_still_missing_is_told_while_a_run_starts(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hub = MemoryHub()
    recorder = Recorder(hub.connect("recorder"), scenario, RUN, RunDirectory(tmp_path / "run"))
    view = View(Console(file=io.StringIO()), scenario, recorder)
    assert "starting 4 robots and the data center: 0 of 5 here" in view.line()
    assert "time left unknown" in shown(view)
    for agent, task in ((0, 0), (1, 1), (3, 2)):
        hub.connect(f"p{agent}").publish(topics.presence(RUN, task, agent), encode_json(Presence(agent=agent)))
    recorder.pump(0.05)
    monkeypatch.setattr(Recorder, "waits", property(lambda self: ["nothing heard of agent-2 (60 s)"]))
    assert view.line().endswith("3 of 5 here; not yet: robot 2, robot 4")  # and that once


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
    text = shown(seen(scenario, recorder))
    assert "4 of 5 rounds in the data center" in " ".join(line_with(text, "Reptile", "rounds"))
    assert line_with(text, "MAML, t0")[-2:] == ["to", "come"]
    assert "9 of 5" not in text  # no stage before the tasks: it serves their rounds


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
    text = shown(seen(scenario, recorder))
    assert "   1  isolated robots      4  40.0 " in text
    assert "0 of 2 learned, round 4" in text


def test_an_arm_that_is_over_is_one_row(isolated: tuple[Scenario, Recorder, Any]) -> None:
    scenario, recorder, say = isolated
    for agent, round_, learned in ((1, 3, True), (2, 7, True), (3, 20, False), (4, 5, True)):
        say(agent, round_, learned)
    # the last robots stopped in rounds 7 and 20; robot 3 had not learned
    assert "isolated robots  1 of 2 learned, 27 rounds" in shown(seen(scenario, recorder))


def test_sidelinks_via_the_base_station_are_priced_on_the_way_too(scenario: Scenario, recorder: Recorder) -> None:
    energy = scenario.energy.model_copy(update={"sidelink": "via_base_station"})
    text = shown(seen(scenario.model_copy(update={"energy": energy}), recorder))
    # Up once, for each has one neighbour: 1.5 MB x 8 / 200 kb/J = 60 J; down 1.67 times as much = 100.2 J
    assert line_with(text, "sidelinks")[1:3] == ["160.2", "J"]


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
    text = shown(seen(scenario.model_copy(update={"energy": energy}), recorder))
    assert line_with(text, "energy ", "288")[-2:] == ["288", "J"]  # twice 144 J
    # a view knows neither messages nor rounds
    assert line_with(text, "energy by cellular")[-3:] == line_with(text, "energy by of")[-3:] == ["at", "the", "end"]
