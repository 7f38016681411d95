"""Options of the charts: what is drawn, in which unit."""

from collections.abc import Callable
from pathlib import Path

from jouleswarm.page import prices
from jouleswarm.page.charts import causes_chart, growth_chart, rewards_chart
from jouleswarm.page.model import Curve, priced
from jouleswarm.page.source import Folder
from jouleswarm.report.sliders import SLIDERS

COMPLETE = {"status": "complete", "counters": ""}


def test_a_bar_stands_for_each_cause_and_arm_with_its_joules_in_words(write_run: Callable[..., Path]) -> None:
    shown = Folder(write_run(COMPLETE)).look()
    assert shown is not None
    arms = [priced(arm, shown.prices, shown.scenario.energy) for arm in shown.arms]
    chart = causes_chart(arms)
    assert chart["yAxis"]["data"] == ["computing, data center", "computing, robots", "uplink", "downlink", "sidelinks"]
    assert [each["color"] for each in chart["series"]] == ["#E69F00", "#0072B2"]  # as in every figure
    robots = chart["series"][0]["data"][1]
    assert (robots["value"], robots["label"]["formatter"]) == (816.0, "816 J")
    growth = growth_chart(arms)
    assert growth["yAxis"]["name"] == "J"
    dear = [priced(arm, shown.prices, prices.repriced(shown.scenario, AT_TEN_TIMES_P0)) for arm in shown.arms]
    assert growth_chart(dear)["yAxis"]["name"] == "kJ"
    assert growth_chart(dear)["series"][0]["data"][-1][1] == dear[0].growth[-1][1] / 1e3


AT_TEN_TIMES_P0 = {each.key: float(each.key == "p0_w") for each in SLIDERS}


def test_robots_curves_are_left_out_where_they_are_many() -> None:
    curves = [Curve("fl", 1, None, ((0, 1.0),)), *(Curve("fl", 1, agent, ((0, 1.0),)) for agent in range(1, 30))]
    few = rewards_chart(curves[:3], 1, {"fl": "FL"}, {"fl": "#0072B2"}, 50.0)
    many = rewards_chart(curves, 1, {"fl": "FL"}, {"fl": "#0072B2"}, 50.0)
    assert [each["name"] for each in few["series"]] == ["FL", "FL, robot 1", "FL, robot 2", "target"]
    assert [each["name"] for each in many["series"]] == ["FL", "target"]
    assert few["series"][-1]["markLine"]["data"] == [{"yAxis": 50.0}]
