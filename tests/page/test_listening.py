"""A deployment elsewhere, heard on its bus."""

from typing import Any

import pytest

from jouleswarm.common.bus.bus import MemoryBus, MemoryHub
from jouleswarm.common.bus.reporter import Telemetry
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Presence, encode_json
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.page.listening import Deployment
from jouleswarm.page.model import priced

RUN = "elsewhere"


@pytest.fixture
def hub() -> MemoryHub:
    return MemoryHub()


@pytest.fixture
def robots(hub: MemoryHub) -> MemoryBus:
    return hub.connect("robots")


@pytest.fixture
def deployment(hub: MemoryHub) -> Deployment:
    return Deployment(hub.connect("page"), load_scenario("toy"), RUN)


def say(bus: MemoryBus, client: str, **fields: Any) -> None:
    row = RoundRow.model_validate({"arm": "fl", "phase": "fl", "seconds": 0.1, **fields})
    bus.publish(topics.telemetry(RUN, "fl", client), encode_json(Telemetry(row=row, received={})))


def test_who_comes_late_knows_the_joules_by_the_newest_rows(robots: MemoryBus, deployment: Deployment) -> None:
    for agent, task in ((1, 1), (2, 1), (3, 2), (4, 2)):
        say(robots, f"agent-{agent}", task=task, agent=agent, round=30, cluster_reward=10.0)
    shown = deployment.look()
    assert shown is not None
    fl = priced(shown.arms[-1], shown.prices, shown.scenario.energy)
    # 30 rounds of 4 robots, 10 gradients each of 5.1 W x 0.4 s, though one row of each was heard
    assert fl.causes["computing, robots"] == pytest.approx(30 * 4 * 10 * 5.1 * 0.4)
    assert (shown.status, shown.counted) == ("listening", False)
    assert deployment.look() is shown  # nothing new


def test_who_goes_and_comes_is_told_once(robots: MemoryBus, deployment: Deployment) -> None:
    at = topics.presence(RUN, 1, 2)
    for state in ("here", "gone", "gone", "here"):
        robots.publish(at, encode_json(Presence(agent=2, state=state)), retain=True)
    shown = deployment.look()
    assert shown is not None
    assert [event.text for event in shown.events] == [
        "agent-2 is gone: its connection broke off",
        "agent-2 is back",
    ]


def test_what_no_process_of_the_run_can_have_said_is_refused(robots: MemoryBus, deployment: Deployment) -> None:
    say(robots, "agent-1", task=1, agent=2, round=1)  # another's row
    say(robots, "agent-9", task=1, agent=9, round=1)
    robots.publish(topics.telemetry(RUN, "fl", "agent-1"), b"no row")
    shown = deployment.look()
    assert shown is not None
    assert shown.curves == ()
    assert set(shown.arms[-1].rounds.values()) == {0}
