"""What it costs a robot to keep its state after each round, beside the round itself, at full size, by CPU time.

    python -m benchmarks.state [--rounds 12]

A round without its exchange: motions, gradient steps, an evaluation. A state: both networks, the optimizer's moments,
22 MB. The first rounds, in which files and memory are new, are left out.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from benchmarks.harness import compare, parser
from jouleswarm.agents.explorer import Explorer
from jouleswarm.common.allocator import keep_freed_memory
from jouleswarm.common.disk.checkpoint import States
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.seeding import stream
from jouleswarm.learning.learner import Learner
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.learning.start import start_weights

_NEW = 3


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--rounds", type=int, default=12)
    rounds = known.parse_args().rounds
    use_one_thread()
    keep_freed_memory()
    scenario = load_scenario("paper", ["methods=['fl']"])
    found: dict[str, list[float]] = {"state": [], "round": []}
    with tempfile.TemporaryDirectory() as folder:
        explorer, weights, states = Explorer(scenario, 1), start_weights(scenario, 1), States(Path(folder), "benchmark")
        network, rng, frames = build_qnetwork(scenario), stream(1, "state"), Path(folder, "frames.bin")
        learner = Learner(network, scenario.learning, weights, rng, frames)
        explorer.begin("fl", scenario.cluster(1))
        for number in range(_NEW + rounds):
            begun = time.process_time()
            explorer.collect(learner, scenario.motions(1))
            learner.learn(scenario.batches(1))
            explorer.evaluate(learner)
            learned = time.process_time()
            states.put("state", {"round": number}, {"learner": learner, "explorer": explorer})
            found["state"].append(time.process_time() - learned)
            found["round"].append(learned - begun)
    print(compare("CPU time", {side: taken[_NEW:] for side, taken in found.items()}), "(goal: 0.02)")


if __name__ == "__main__":
    main()
