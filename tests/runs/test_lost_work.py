"""What faults have cost in computing: done, not kept, and done again."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from jouleswarm.common.meter.work import WorkRow
from jouleswarm.report.report import print_report
from jouleswarm.report.tables import lost_tables
from jouleswarm.runs.lost_work import lost_work
from jouleswarm.runs.run import load_run
from jouleswarm.runs.summary import summarise

MOTIONS = 20  # of a round, by default
Write = Callable[..., Path]


def work(client: str, phase: Any, arm: str, task: int, gradients: int, query: int = 0, motions: int = 0) -> WorkRow:
    return WorkRow(
        client=client, phase=phase, arm=arm, task=task, gradients=gradients, gradients_query=query, motions=motions
    )


def undisturbed() -> list[WorkRow]:
    """What the made-up run comes to: 20 gradients and 20 motions a round, 3 rounds of meta-learning."""
    rows = [work("datacenter", "maml", "maml", task, 30, 30) for task in (1, 2)]
    rows += [work(f"agent-{agent}", "maml", "maml", task, 0, 0, 3 * MOTIONS) for task, agent in ((1, 1), (2, 3))]
    for arm, rounds in (("maml", {1: 4, 2: 6}), ("fl", {1: 10, 2: 20})):
        for task, agents in ((1, (1, 2)), (2, (3, 4))):
            rows += [
                work(f"agent-{agent}", "fl", arm, task, 20 * rounds[task], 0, MOTIONS * rounds[task])
                for agent in agents
            ]
    return rows


def disturbed() -> list[WorkRow]:
    """Robot 1 was killed after 7 gradients and 20 motions of a round, the data center after one of 10 + 10."""
    more = {("agent-1", "fl", "maml"): (7, 0, MOTIONS), ("datacenter", "maml", "maml"): (10, 10, 0)}
    found = []
    for row in undisturbed():
        plain, query, motions = more.get((row.client, row.phase, row.arm), (0, 0, 0)) if row.task == 1 else (0, 0, 0)
        counts = row.gradients + plain, row.gradients_query + query, row.motions + motions
        found.append(work(row.client, row.phase, row.arm, row.task, *counts))
    return found


def test_undisturbed_nothing_is_lost_and_nothing_is_said(facts: Any) -> None:
    assert lost_work(facts.scenario, facts.rows, undisturbed()) == []
    plain = summarise(facts.scenario, facts.rows, facts.meter_rows)
    counted = summarise(facts.scenario, facts.rows, facts.meter_rows, work_rows=undisturbed())
    assert json.dumps(plain) == json.dumps(counted)


def test_what_was_done_and_is_in_no_row_is_lost(facts: Any) -> None:
    assert lost_work(facts.scenario, facts.rows, disturbed()) == [
        work("datacenter", "maml", "maml", 1, 10, 10),
        work("agent-1", "fl", "maml", 1, 7, 0, MOTIONS),
    ]


def test_counts_that_a_power_failure_has_set_back_make_nothing_of_nothing(facts: Any) -> None:
    assert lost_work(facts.scenario, facts.rows, [work("agent-1", "fl", "maml", 1, 3)]) == []


def test_lost_work_is_in_the_bill_and_told_beside_it(facts: Any) -> None:
    plain = summarise(facts.scenario, facts.rows, facts.meter_rows)["arms"]
    found = summarise(facts.scenario, facts.rows, facts.meter_rows, work_rows=disturbed())["arms"]
    lost = found["maml"]["lost_work"]
    assert (lost["gradients_support"], lost["gradients_query"], lost["gradients_robots"]) == (10, 10, 7)
    assert lost["motions"] == MOTIONS
    # 20 gradients x 590 W x 0.02 s x 1.67, and 7 x 5.1 W x 0.4 s
    assert lost["computing_datacenter_j"] == pytest.approx(394.12)
    assert lost["computing_robots_j"] == pytest.approx(14.28)
    before, after = (arms["maml"]["energy_j"]["literal"] for arms in (plain, found))
    assert lost["literal_without_j"] == pytest.approx(before)
    assert after["total"] - before["total"] == pytest.approx(394.12 + 14.28)
    assert after["ml_learning"] - before["ml_learning"] == pytest.approx(394.12)
    assert found["maml"]["counts"]["fl"]["gradients_robots"] == plain["maml"]["counts"]["fl"]["gradients_robots"] + 7
    assert found["fl"] == plain["fl"]


def test_the_report_shows_what_was_lost_and_the_bill_with_and_without(write_run: Write, facts: Any) -> None:
    path = write_run(summarise(facts.scenario, facts.rows, facts.meter_rows))
    assert lost_tables(load_run(path), facts.scenario.energy) == []
    (path / "work.jsonl").write_text("".join(row.model_dump_json() + "\n" for row in disturbed()))
    run = load_run(path)
    (table,) = lost_tables(run, run.scenario.energy)
    # 3187.92 J by the rows alone
    assert table.rows[0] == ["MAML, t0 = 3", "7", "20", "20", "14.28 J", "394.1 J", "3.596 kJ", "3.188 kJ"]
    assert table.rows[1][1:6] == ["0", "0", "0", "0 J", "0 J"]
    console = Console(file=io.StringIO(), width=160)
    print_report(run, console=console, details=True)
    assert "Done and not kept" in console.file.getvalue()  # type: ignore[attr-defined]
