"""A whole robot round over the bus beside the same round over the in-memory bus.

    python -m benchmarks.bus_round [--rounds 10] [--pairs 3]

Two robots of one task, paper-size network and frames: collect, learn, evaluate, exchange weights, mix. The bus
side is two robot processes and the embedded broker. The in-memory side is two processes too (threads of one would
wait for each other's interpreter lock), each with one robot on an in-memory bus: the same work without a network,
and without a neighbour to wait for.
"""

from __future__ import annotations

import multiprocessing
import statistics
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from benchmarks.harness import compare, in_turn, parser
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.fleet.deploy import run_deployment
from jouleswarm.runs.directory import ROUNDS
from jouleswarm.simulation import run_in_memory

SCENARIO = "scenarios/paper.toml"
SETTINGS = ['methods=["fl"]', "federation.target_reward=1e9"]


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--rounds", type=int, default=10)
    known.add_argument("--pairs", type=int, default=3, help="how often both sides are measured, in turn")
    options = known.parse_args()
    overrides = [*SETTINGS, f"federation.max_rounds={options.rounds}", _one_task()]
    sides = {"bus": lambda: _over_the_bus(overrides), "in memory": lambda: _in_memory(overrides)}
    print(f"{compare('a round', in_turn(sides, options.pairs, 0), 's', 1)} (goal: 1.10)")


def _over_the_bus(overrides: list[str]) -> float:
    scenario = load_scenario(SCENARIO, overrides)
    with tempfile.TemporaryDirectory() as folder:
        run = run_deployment(scenario, "bus", Path(folder), Console(quiet=True))
        lines = (run / ROUNDS).read_text().splitlines()
    return _round_s([RoundRow.model_validate_json(line) for line in lines])


def _in_memory(overrides: list[str]) -> float:
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        return statistics.mean(pool.map(_alone, [overrides] * 2, chunksize=1))


def _alone(overrides: list[str]) -> float:
    use_one_thread()
    scenario = load_scenario(SCENARIO, [*overrides, "federation.robots_per_cluster=1"])
    return _round_s(run_in_memory(scenario).rows)


def _one_task() -> str:
    task = load_scenario(SCENARIO).task(1)
    drawing = task.map.strip().replace("\n", "\\n")
    return f'tasks=[{{id = 1, map = "{drawing}"}}]'


def _round_s(rows: Sequence[RoundRow]) -> float:
    return statistics.median(row.seconds for row in rows if row.round > 1)


if __name__ == "__main__":
    main()
