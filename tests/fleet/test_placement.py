"""Processes are spread over a cluster's workers evenly, and always in the same way."""

from __future__ import annotations

from jouleswarm.fleet.placement import placed

A, B, C = "tcp://10.0.0.1:1", "tcp://10.0.0.2:1", "tcp://10.0.0.3:1"


def test_processes_go_round_workers_of_equal_size() -> None:
    assert placed(["datacenter", "agent-1", "agent-2", "agent-3", "agent-4"], {A: 1, B: 1}) == {
        A: ["datacenter", "agent-2", "agent-4"],
        B: ["agent-1", "agent-3"],
    }


def test_a_worker_of_three_threads_gets_three_times_as_many() -> None:
    names = [f"agent-{number}" for number in range(1, 9)]
    assert {worker: len(theirs) for worker, theirs in placed(names, {A: 1, B: 3}).items()} == {A: 2, B: 6}


def test_a_worker_for_which_there_is_nothing_is_left_out() -> None:
    assert placed(["agent-1", "agent-2"], {A: 1, B: 1, C: 1}) == {A: ["agent-1"], B: ["agent-2"]}


def test_the_order_in_which_workers_came_changes_nothing() -> None:
    names = ["datacenter", "agent-1", "agent-2"]
    assert placed(names, {C: 2, A: 2, B: 2}) == placed(names, {A: 2, B: 2, C: 2})
