"""A whole run in one process over the in-memory bus: same loops, same results, no broker.

python -m jouleswarm.simulation quick --set seed=2
"""

from __future__ import annotations

import argparse
import threading
import time
from collections.abc import Callable

from jouleswarm.agents.robot import run_agent
from jouleswarm.common.bus.bus import MemoryBus, MemoryHub
from jouleswarm.common.bus.reporter import Telemetry
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import decode_json
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.datacenter.center import run_datacenter


class Outcome:
    """What a run left behind."""

    def __init__(self) -> None:
        self.rows: list[RoundRow] = []
        self.learned: dict[tuple[str, int], bytes] = {}
        self.snapshots: dict[tuple[str, int], bytes] = {}
        self.hub = MemoryHub()


def run_in_memory(scenario: Scenario, run: str = "memory") -> Outcome:
    """Run data center and robots as threads; an error in any of them is raised here."""
    outcome, errors = Outcome(), []
    recorder = outcome.hub.connect("recorder")
    recorder.subscribe(topics.telemetry(run, "+", "+"), topics.learned(run, "+", "+"), topics.snapshot(run, "+", "+"))

    def start(client: str, body: Callable[[MemoryBus], None]) -> threading.Thread:
        bus = outcome.hub.connect(client)

        def guarded() -> None:
            use_one_thread()  # a setting of each thread: without it sums are cut up otherwise than in a robot's process
            try:
                body(bus)
            except BaseException as error:
                errors.append(error)
                raise

        thread = threading.Thread(target=guarded, name=client, daemon=True)
        thread.start()
        return thread

    threads = [
        start(f"agent-{agent}", lambda bus, agent=agent: run_agent(scenario, agent, run, bus))  # type: ignore[misc]
        for agent in scenario.agents
    ]
    if scenario.needs_datacenter:
        threads.append(start("datacenter", lambda bus: run_datacenter(scenario, run, bus)))
    while any(thread.is_alive() for thread in threads) and not errors:
        _take_all(recorder, outcome, 0.1)
    if errors:
        raise errors[0]
    _take_all(recorder, outcome, 0.0)
    outcome.rows.sort(key=RoundRow.sort_key)
    return outcome


def _take_all(recorder: MemoryBus, outcome: Outcome, timeout_s: float) -> None:
    while (message := recorder.receive(timeout_s or 0.001)) is not None:
        level = message.topic.split("/")
        if level[-1] == "round":
            outcome.rows.append(decode_json(message.payload, Telemetry).row)
        elif level[-1] == "learned":
            outcome.learned[level[2], int(level[4])] = bytes(message.payload)
        else:
            outcome.snapshots[level[2], int(level[4])] = bytes(message.payload)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    arguments = parser.parse_args()
    use_one_thread()
    scenario = load_scenario(arguments.scenario, arguments.overrides)
    begun = time.monotonic()
    outcome = run_in_memory(scenario)
    for arm in scenario.arm_names:
        ends = {}
        for row in outcome.rows:
            if row.arm == arm and row.phase == RowPhase.FL:
                ends[row.task] = (row.round, row.learned, row.cluster_reward)
        told = " ".join(
            f"{task}:{n}{'' if ok else '!'}({-999 if r is None else r:.0f})" for task, (n, ok, r) in ends.items()
        )
        print(f"{arm:8} sum {sum(n for n, _, _ in ends.values()):4}  {told}")
    print(f"{time.monotonic() - begun:.1f} s")


if __name__ == "__main__":
    main()
