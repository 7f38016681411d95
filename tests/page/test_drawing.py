"""The drawing, the maps and the words of the page."""

from xml.etree import ElementTree

import pytest

from jouleswarm.common.scenario.reading import load_scenario, scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.page.drawing import layout, svg, thickness
from jouleswarm.page.maps import Walk, map_svg
from jouleswarm.page.model import Moved


def fleet(tasks: int, robots: int) -> Scenario:
    maps = [{"id": task, "map": "E\nX", "robots": robots} for task in range(1, tasks + 1)]
    return scenario_from({"name": "fleet", "world": {"rows": 2, "cols": 1}, "methods": ["fl"], "tasks": maps}, "test")


def test_a_link_of_a_quarter_of_the_bytes_is_half_as_much_thicker_than_the_thinnest() -> None:
    assert thickness(0, 100) == 0
    assert thickness(100, 100) == 14.0
    assert thickness(25, 100) == pytest.approx(0.8 + (14.0 - 0.8) / 2)


@pytest.mark.parametrize(("tasks", "robots"), [(1, 1), (2, 2), (6, 2), (6, 10), (1, 50), (20, 5)])
def test_every_robot_stands_in_the_frame_of_its_cluster_and_no_two_at_one_place(tasks: int, robots: int) -> None:
    scenario = fleet(tasks, robots)
    boxes, places, height = layout(scenario)
    for box in boxes:
        assert 0 <= box.x < box.x + box.width <= 480
        for agent in scenario.cluster(box.task):
            at = places[f"agent-{agent}"]
            assert box.x <= at.x <= box.x + box.width
            assert box.y <= at.y <= box.y + box.height <= height
    if tasks * robots <= 60:
        assert len(set(places.values())) == len(places)


def test_the_drawing_is_well_formed_and_says_what_went_over_each_link() -> None:
    moved = [Moved("uplink", "agent-1", "datacenter", 1e6), Moved("sidelink", "agent-1", "agent-2", 2.5e5)]
    drawn = ElementTree.fromstring(svg(load_scenario("toy"), moved))
    titles = [each.text for each in drawn.iter("title")]
    assert "agent-1 to broker, uplink: 1 MB" in titles
    assert "broker to datacenter, uplink: 1 MB" in titles
    assert "agent-1 to agent-2, sidelink: 250 kB" in titles


def test_a_robot_follows_its_path_over_the_map() -> None:
    walk = Walk("MAML <3", "#E69F00", ((0, 1), (1, 1), (2, 1)), is_learning=True)
    drawn = ElementTree.fromstring(map_svg(load_scenario("toy"), 2, [walk]))
    (motion,) = drawn.iter("animateMotion")
    # landmarks are 32 apart, the first column's middle at 6 + 16
    assert motion.get("path") == "M 54.0 22.0 L 54.0 54.0 L 54.0 86.0"
    assert [each.text for each in drawn.iter("text")] == ["E", "X"]
    assert "MAML <3: 2 motions, still learning" in [each.text for each in drawn.iter("title")]
