"""A robot whose battery is empty stops, and its cluster goes on without it."""

from __future__ import annotations

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.simulation import run_in_memory


def test_a_robot_stops_when_its_joules_are_spent_and_its_cluster_goes_on() -> None:
    # A round is 10 gradients at 2.04 J: 62 J or 75 J last 3 rounds. Each arm begins with a full battery; in the first
    # robot 1 sends 20 frames of 64 x 48 x 4 bytes up before, some 20 J at 100 kb/J: 55 J are left, for 2 rounds.
    changes: list[str | tuple[str, object]] = [
        "federation.on_missing=proceed",
        "federation.max_rounds=5",
        "federation.target_reward=1000",
        "meta.t0=2",
        "energy.sl_bit_per_j=1e15",
        "energy.ul_bit_per_j=1e15",
        ("robots", [{"id": 1, "ul_bit_per_j": 1e5, "battery_j": 75.0}, {"id": 4, "battery_j": 62.0}]),
    ]
    outcome = run_in_memory(load_scenario("toy", changes))
    ends = {(row.arm, row.agent): row for row in outcome.rows if row.phase == "fl" and row.learned is not None}
    assert [ends["maml", robot].round for robot in (1, 2, 3, 4)] == [2, 5, 5, 3]
    assert [ends["fl", robot].round for robot in (1, 2, 3, 4)] == [3, 5, 5, 3]
    assert not any(row.learned for row in ends.values())
    alone = [row.round for row in outcome.rows if (row.arm, row.agent, row.missed) == ("fl", 2, (1,))]
    assert alone == [4, 5]
    assert set(outcome.learned) == {(arm, task) for arm in ("maml", "fl") for task in (1, 2)}
