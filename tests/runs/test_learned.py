"""In which round a task counts as learned, by each measure; old rows too."""

from __future__ import annotations

import csv
from collections import defaultdict
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.runs.facts import task_results
from jouleswarm.runs.lost_work import motions_of

AUDITED = Path(__file__).parents[1] / "studies" / "audited" / "facts.csv"
TASK = {"id": 1, "map": "E * * X"}


def scenario(**federation: Any) -> Any:
    """One cluster; R is the mean of 3 rounds, 50 is enough."""
    settings = {"reward_window": 3, "target_reward": 50, **federation}
    world = {"rows": 1, "cols": 4}
    return scenario_from({"name": "x", "world": world, "tasks": [TASK], "methods": ["fl"], "federation": settings}, "x")


def rows(rewards: list[float], agents: int = 2, first: int = 1, **more: Any) -> list[RoundRow]:
    """R of each round, the same for all robots."""
    return [
        RoundRow(phase="fl", arm="fl", task=1, agent=agent, round=round_, cluster_reward=reward, seconds=1.0, **more)
        for round_, reward in enumerate(rewards, start=first)
        for agent in range(1, agents + 1)
    ]


@pytest.mark.parametrize(
    ("rewards", "first", "full", "partial"),
    [
        ([40, 60, 40, 55], 1, 4, 2),
        ([60, 60, 60], 1, 3, 1),
        ([60], 1, None, 1),  # an old run that ended by a partial window
        ([10, 40, 49], 1, None, None),
        ([70], 0, 0, 0),
        ([10, 40, 70], 0, None, 2),
    ],
)
def test_both_measures_are_told_from_rows(
    rewards: list[float], first: int, full: int | None, partial: int | None
) -> None:
    (found,) = task_results(scenario(), rows(rewards, first=first), "fl")
    assert (found.full_window, found.partial_window) == (full, partial)


def test_where_neighbours_pass_r_on_a_whole_window_is_known_later() -> None:
    # 4 robots in a ring are 2 hops apart: in round 4 they know R of rounds 1 to 3
    ring = scenario(robots_per_cluster=4, topology="ring")
    (found,) = task_results(ring, rows([60, 60, 60, 60], agents=4), "fl")
    assert (found.full_window, found.partial_window) == (4, 1)


def test_episodes_that_missed_the_exit_are_told_over_the_window() -> None:
    told = [rows([r], first=n, measures={"reached": reached}) for n, r, reached in
            ((1, 0, 0.0), (2, 40, 0.0), (3, 50, 1.0), (4, 55, 1.0))]  # fmt: skip
    (found,) = task_results(scenario(), [row for each in told for row in each], "fl")
    assert (found.missed_exits, found.episodes) == (2, 6)  # rounds 2 to 4 of two robots, round 2 without exit
    (at_once,) = task_results(scenario(), rows([70], first=0, measures={"reached": 2 / 3}), "fl")
    assert (at_once.missed_exits, at_once.episodes) == (2, 6)  # one of three episodes each
    (old,) = task_results(scenario(), rows([70, 70, 70]), "fl")
    assert (old.missed_exits, old.episodes) == (None, 0)


def test_motions_of_old_rows_are_those_of_the_scenario() -> None:
    old, new = rows([1.0])[0], rows([1.0], first=0, motions=0)[0]
    assert (motions_of(scenario(), old), motions_of(scenario(), new)) == (20, 0)


def test_in_an_earlier_study_the_partial_window_is_what_makes_240_of_192() -> None:
    # Compact, t0 = 90: the sum of t_i without transfer over that with it, and the same with t_i >= 5, R's window.
    sums: dict[tuple[str, int], dict[str, int]] = defaultdict(lambda: defaultdict(int))
    with AUDITED.open() as file:
        for fact in csv.DictReader(file):
            if fact["task"] != "0" and (fact["method"] == "fl" or fact["t0"] == "90"):
                for least in (0, 5):
                    sums[fact["method"], least][fact["seed"]] += max(least, int(fact["rounds"]))
    means = {key: fmean(of_seed.values()) for key, of_seed in sums.items()}
    assert means["fl", 0] / means["multitask", 0] == pytest.approx(2.40, abs=0.005)
    assert means["fl", 5] / means["multitask", 5] == pytest.approx(1.92, abs=0.005)
