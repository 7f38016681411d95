"""One unit of `benchmarks.tuning`: a scenario with its settings as a line of JSON on stdin, what came out on stdout.

It ends when its stdin is closed, so that nothing runs on when the tuner has been stopped or killed.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time

from benchmarks.recipe import summary
from jouleswarm.common.errors import TrainingError
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.simulation import run_in_memory


def measure(name: str, overrides: list[str]) -> dict[str, object]:
    """Rounds by the reward window, summed over all tasks and over those seen in meta-training and not; processor time.

    A task that is not learned counts as `federation.max_rounds`; so do all where meta-training fails.
    """
    scenario = load_scenario(name, overrides)
    (arm,) = scenario.arm_names
    begun_s = time.process_time()
    try:
        _, first, failed, of_tasks = summary(scenario, run_in_memory(scenario).rows, arm)
        rounds = dict(zip(scenario.clusters, map(int, of_tasks.split()), strict=True))
    except TrainingError:
        rounds = dict.fromkeys(scenario.clusters, scenario.federation.max_rounds)
        first, failed = sum(rounds.values()), len(rounds)
    seen = sum(rounds[task] for task in scenario.meta.training_tasks)
    every = sum(rounds.values())
    return {
        "rounds": every, "rounds_first": first, "not_learned": failed, "seen": seen, "unseen": every - seen,
        "cpu_s": round(time.process_time() - begun_s, 1),
    }  # fmt: skip


def _end_with_stdin() -> None:
    while os.read(0, 1):
        pass
    os._exit(1)


if __name__ == "__main__":
    use_one_thread()
    given = json.loads(sys.stdin.buffer.readline())
    threading.Thread(target=_end_with_stdin, daemon=True).start()
    print(json.dumps(measure(**given)), flush=True)
    os._exit(0)  # robots' threads may still wait where meta-training failed
