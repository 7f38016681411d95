"""What the page shows of a run: numbers worked out by hand from the made-up run (tests/made_up_run.py)."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.errors import RunError
from jouleswarm.page import prices
from jouleswarm.page.model import ArmPriced, Shown, priced
from jouleswarm.page.source import Folder
from jouleswarm.report.sliders import SLIDERS
from jouleswarm.runs.events import Event, note_event

COMPLETE = {"status": "complete", "counters": ""}
AT_REST = {each.key: 0.0 for each in SLIDERS}


def look(path: Path) -> Shown:
    found = Folder(path).look()
    assert found is not None
    return found


def arm(shown: Shown, name: str, **positions: float) -> ArmPriced:
    energy = prices.repriced(shown.scenario, {**AT_REST, **positions})
    (found,) = (each for each in shown.arms if each.name == name)
    return priced(found, shown.prices, energy)


def test_an_arm_costs_what_its_gradients_and_bytes_come_to(write_run: Callable[..., Path]) -> None:
    maml = arm(look(write_run(COMPLETE)), "maml")
    assert maml.causes == {
        "computing, data center": pytest.approx(3 * 2 * 20 * 1.67 * 590 * 0.02),
        "computing, robots": pytest.approx((4 + 6) * 2 * 20 * 5.1 * 0.4),
        "uplink": pytest.approx(2 * 60 * 1000 * 8 / 200e3),
        "downlink": pytest.approx(4 * 5000 * 8 / 200e3),
        "sidelinks": pytest.approx((4 + 6) * 2 * 5000 * 8 / 500e3),
    }
    assert maml.total_j == pytest.approx(sum(maml.causes.values()))
    assert maml.grams is None
    assert maml.growth[0] == (0, pytest.approx(2364.72 + 4.8 + 0.8))  # the stage alone
    assert maml.growth[-1] == (6, pytest.approx(maml.total_j))


def test_other_prices_are_of_the_same_facts(write_run: Callable[..., Path]) -> None:
    shown = look(write_run(COMPLETE))
    moved = arm(shown, "maml", ul_bit_per_j=1.0, pk_w=-1.0, datacenter_g_per_kwh=360.0, robots_g_per_kwh=36.0)
    assert moved.causes["uplink"] == pytest.approx(4.8 / 10)  # ten times as efficient
    assert moved.causes["downlink"] == pytest.approx(0.8 / 10)  # E_DL is E_UL unless set
    assert moved.causes["computing, robots"] == pytest.approx(816 / 10)
    datacenter_j, robots_j = 2364.72 + 0.08, 81.6 + 0.48 + 1.6
    assert moved.grams == pytest.approx((datacenter_j * 360 + robots_j * 36) / 3.6e6)


def test_a_slider_at_rest_is_the_runs_own_price_and_half_way_up_its_square_root_of_ten(
    write_run: Callable[..., Path],
) -> None:
    energy = look(write_run(COMPLETE)).scenario.energy
    uplink, carbon = SLIDERS[0], SLIDERS[-1]
    assert prices.value_text(uplink, 0.0, energy) == "200 kb/J"
    assert prices.value_text(uplink, 0.5, energy) == "632.5 kb/J"
    assert prices.value_text(carbon, 0.0, energy) == "not known"
    assert prices.value_text(carbon, 40.0, energy) == "40 g/kWh"
    assert prices.command("runs/a b", {**AT_REST, "ul_bit_per_j": 0.5}, energy) == (
        "jouleswarm report 'runs/a b' --set energy.ul_bit_per_j=632500"
    )


def test_bytes_are_told_link_by_link_and_an_onlookers_are_nobodys(write_run: Callable[..., Path]) -> None:
    moved = {each[:3]: each.bytes for each in look(write_run(COMPLETE)).moved}
    assert moved["uplink", "agent-1", "datacenter"] == 60 * 1000
    assert moved["downlink", "datacenter", "agent-4"] == 5000
    assert moved["sidelink", "agent-1", "agent-2"] == (4 + 10) * 5000  # both arms
    assert not any("mosquitto_sub" in key for key in moved)


def test_rewards_are_of_each_cluster_and_robot(write_run: Callable[..., Path]) -> None:
    curves = {each[:3]: each.points for each in look(write_run(COMPLETE)).curves}
    assert curves["maml", 1, None] == tuple((round_, pytest.approx(55 * round_ / 4)) for round_ in (1, 2, 3, 4))
    assert curves["maml", 1, 2][-1] == (4, 61.0)
    assert len(curves) == 2 * (2 + 4)


def test_a_run_without_counters_yet_is_told_by_the_closed_form(write_run: Callable[..., Path]) -> None:
    path = write_run(None)
    with Lock(path, "a run"):
        shown = look(path)
    assert (shown.status, shown.counted) == ("running", False)
    assert arm(shown, "fl").causes["computing, robots"] == pytest.approx((10 + 20) * 2 * 20 * 5.1 * 0.4)
    assert look(path).status == "interrupted"


def test_what_happened_is_told_in_the_order_of_time(write_run: Callable[..., Path]) -> None:
    path = write_run(COMPLETE)
    rows = [json.loads(line) for line in (path / "rounds.jsonl").read_text().splitlines()]
    keys = ("phase", "arm", "task", "agent", "round")
    told = [{"time_s": 100.0 + place, **{key: row[key] for key in keys}} for place, row in enumerate(rows)]
    (path / "times.jsonl").write_text("".join(json.dumps(each) + "\n" for each in told))
    note_event(path, Event(time_s=99.0, text="agent-3 was ended by SIGKILL; starting it again"))
    texts = [event.text for event in look(path).events]
    assert texts[0] == "agent-3 was ended by SIGKILL; starting it again"
    assert "MAML: 3 rounds of meta-learning done, the model goes down" in texts
    assert "MAML, t0 = 3: task 2 learned after 6 rounds" in texts
    assert "FL, no transfer: task 2 not learned after 20 rounds" in texts
    assert len(texts) == 1 + 1 + 4


def test_nothing_is_shown_of_a_run_that_has_not_begun_and_a_damaged_one_is_told(write_run: Callable[..., Path]) -> None:
    path = write_run(COMPLETE)
    assert Folder(path / "weights").look() is None
    (path / "rounds.jsonl").write_text("no row\n")
    with pytest.raises(RunError, match=r"rounds\.jsonl, line 1: damaged"):
        Folder(path).look()


def test_a_stage_that_arms_share_was_moved_once(write_run: Callable[..., Path]) -> None:
    shown = look(write_run(COMPLETE, meta={"t0": 3, "training_tasks": [1, 2], "adapt_from": [1]}))
    assert len(shown.arms) == 3
    moved = {each[:3]: each.bytes for each in shown.moved}
    assert moved["uplink", "agent-1", "datacenter"] == 60 * 1000
