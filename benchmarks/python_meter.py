"""What `jouleswarm.Meter` adds to a training loop, files written included, and to the start of a process.

    python -m benchmarks.python_meter [--calls 50000] [--rounds 7]

By CPU time of this thread: whatever else the machine does moves the wall clock. The loop around a call is in its
figure. A ratio is of the median to the goal.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.harness import in_turn, parser
from jouleswarm import Meter

GOALS_US = {"import": 150_000.0, "phase": 20.0, "count": 2.0, "gradients": 2.0}
_TIMED = "import time; begun = time.process_time(); {}; print(time.process_time() - begun)"


def main() -> None:
    made = parser(__doc__)
    made.add_argument("--calls", type=int, default=50_000)
    made.add_argument("--rounds", type=int, default=7)
    options = made.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        meter = Meter("client-1", file=Path(folder, "counts.csv"))
        sides = {
            "import": _import_s,
            "phase": lambda: _each_s(options.calls, lambda number: _phase(meter, number)),
            "count": lambda: _each_s(options.calls, lambda number: meter.sent("uplink", 1000)),
            "gradients": lambda: _each_s(options.calls, lambda number: meter.gradients(20)),
        }
        found = in_turn(sides, options.rounds)
        meter.close()
    for name, seconds in found.items():
        told = [1e6 * each for each in (statistics.median(seconds), min(seconds), max(seconds))]
        ratio = told[0] / GOALS_US[name]
        print(f"{name}: {told[0]:.4g} us ({told[1]:.4g} to {told[2]:.4g}; goal {GOALS_US[name]:g}), ratio {ratio:.3f}")


def _import_s() -> float:
    code = _TIMED.format("from jouleswarm import Meter")
    return float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)


def _phase(meter: Meter, number: int) -> None:
    with meter.phase("train", round=number // 100):
        pass


def _each_s(calls: int, call: Callable[[int], object]) -> float:
    """Of one call of many."""
    begun = time.thread_time()
    for number in range(calls):
        call(number)
    return (time.thread_time() - begun) / calls


if __name__ == "__main__":
    main()
