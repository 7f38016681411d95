"""What `--measure` adds: the same run on the in-memory bus with it and without, in turn, by CPU time.

    python -m benchmarks.measure [--scenario toy] [--pairs 7]

CPU time, because whatever else the machine does moves the wall clock by more than 1%. The second line counts instead:
how often an activity begins or ends, times what booking one costs.
"""

from __future__ import annotations

import argparse
import statistics
import time

from jouleswarm.common.meter.joule_meter import JouleMeter
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.measure import Measure
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.simulation import run_in_memory

CALLS = 100_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="toy")
    parser.add_argument("--pairs", type=int, default=7, help="how often both sides are measured, in turn")
    options = parser.parse_args()
    use_one_thread()
    _run_s(options.scenario, measured=False)  # warm-up
    pairs = []
    for number in range(options.pairs):
        order = (True, False) if number % 2 else (False, True)
        took = {measured: _run_s(options.scenario, measured=measured) for measured in order}
        pairs.append((took[True], took[False]))
    measured_s, plain_s = (statistics.median(side) for side in zip(*pairs, strict=True))
    ratios = sorted(measured / plain for measured, plain in pairs)
    print(
        f"CPU time of a run: measured {measured_s:.3f} s, plain {plain_s:.3f} s, ratio {statistics.median(ratios):.4f} "
        f"({ratios[0]:.3f} to {ratios[-1]:.3f}; goal: 1.01)"
    )
    booked, cost_s = _bookings(options.scenario), _booking_s()
    share = booked * cost_s / plain_s
    print(f"{booked} bookings x {1e6 * cost_s:.1f} us = {1e3 * booked * cost_s:.1f} ms, {100 * share:.2f}% of the run")


def _run_s(scenario: str, *, measured: bool) -> float:
    settings = load_scenario(scenario, [("measure.energy", measured)])
    begun = time.process_time()
    run_in_memory(settings)
    return time.process_time() - begun


def _bookings(scenario: str) -> int:
    """Of all clients of a run."""
    count, go = 0, JouleMeter._go

    def counted(self: JouleMeter, place: str, activity: str) -> None:
        nonlocal count
        count += 1
        go(self, place, activity)  # type: ignore[arg-type]

    JouleMeter._go = counted  # type: ignore[method-assign, assignment]
    _run_s(scenario, measured=True)
    JouleMeter._go = go  # type: ignore[method-assign]
    return count


def _booking_s() -> float:
    meter = Meter("client")
    meter.measure(Measure(energy=True))
    begun = time.process_time()
    for _ in range(CALLS // 2):
        with meter.energy.during("idle"):
            pass
    return (time.process_time() - begun) / CALLS


if __name__ == "__main__":
    main()
