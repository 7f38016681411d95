"""A whole run in memory that measures itself."""

from __future__ import annotations

import pytest

from jouleswarm.common.meter.joules import joules_rows
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.simulation import run_in_memory

SMALL = ("meta.t0=1", "learning.motions_per_round=6", "learning.batches_per_round=2", "federation.max_rounds=2")


def test_every_process_measures_all_that_it_does_and_learns_the_same() -> None:
    scenario = load_scenario("toy", [*SMALL, "measure.energy=true", "measure.tdp_w=20", "measure.cores=2"])
    done, plain = run_in_memory(scenario), run_in_memory(load_scenario("toy", SMALL))
    assert done.learned == plain.learned
    for client in ("agent-1", "agent-4", "datacenter"):
        rows = joules_rows(client, done.hub._clients[client].meter._counters.items())  # as handed in
        places = {(row.phase, row.arm, row.activity) for row in rows}
        assert ("", "", "start") in places
        assert {("maml", "maml", each) for each in ("communication", "idle")} <= places
        assert (client == "agent-4") == (("maml", "maml", "learning") not in places)  # task 2 is not trained on
        assert (client == "datacenter") == (("fl", "fl", "learning") not in places)
        assert all(row.how == "estimated: CPU time x 10 W" for row in rows)
        assert [row.joules for row in rows] == pytest.approx([10 * row.cpu_s for row in rows], abs=1e-6)
        assert plain.hub._clients[client].meter.joules(client) == []
        idle, busy = (
            [(row.cpu_s, row.seconds) for row in rows if (row.activity == "idle") == idle] for idle in (True, False)
        )
        assert sum(cpu for cpu, _ in idle) < sum(cpu for cpu, _ in busy)
        assert all(0 <= cpu <= seconds + 0.1 for cpu, seconds in (*idle, *busy))
