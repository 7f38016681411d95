"""What 10^3 to 10^6 robots need of brokers and recorders, from what robot-rounds were measured to cost.

    python -m benchmarks.scale_model [--robots 1000 10000 100000 1000000] [--seconds 8]
    python -m benchmarks.scale_model --check 1000

The first prints the table of docs/scale.md by `energy/infrastructure.py`; `--seconds` is how long a round takes a robot
(default: the paper's 20 gradients of 0.4 s). The second runs so many robots for two rounds in one process, over the
in-memory bus that counts as a broker does, and 40 before: what a robot-round of 40 has, times the robots, against what
was counted. Networks and worlds of the toy, a gradient and four motions a round.
"""

from __future__ import annotations

import resource
import time
from typing import NamedTuple

from benchmarks.harness import parser
from benchmarks.scale import CLUSTER, OVERRIDES, WORLD, tasks_of
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.energy.infrastructure import RobotRound, infrastructure
from jouleswarm.simulation import run_in_memory

PAPER_SECONDS = 20 * 0.4
# By `python -m benchmarks.scale` of 200 and, with --size quick, 48 robots: broker's and run's CPU time, wire bytes.
MEASURED = {
    "toy": (3.4e-3, 6.2e-3, 123_909),
    "compact": (5.1e-3, 7.77e-3, 1_838_813),
}
FEW, ROUNDS = 40, 2
SMALL = (
    "learning.batches_per_round=1",
    "learning.motions_per_round=4",
    "learning.batch_size=4",
    "learning.replay_size=50",
)


class Counted(NamedTuple):
    """What a run in memory counted."""

    rows: int
    messages: int
    wire_bytes: int
    cpu_s: float
    peak_mb: float


def table(robots: list[int], seconds: float) -> None:
    """Print it, a row for each size and number of robots."""
    print("| size | robots | robots a broker (limit) | brokers | recorders | MB a second | kJ a round | J a robot |")
    print("|---|---|---|---|---|---|---|---|")
    for size, (broker_s, recorder_s, wire_bytes) in MEASURED.items():
        each = RobotRound(seconds, broker_s, recorder_s, wire_bytes)
        for count in robots:
            found = infrastructure(count, CLUSTER, each)
            print(
                f"| {size} | {count:,} | {found.robots_per_broker} ({found.limit}) | {found.brokers:,} | "
                f"{found.recorders:,} | {found.bytes_per_s / 1e6:,.0f} | {found.joules / 1e3:,.3g} | "
                f"{found.joules / count:.2f} |"
            )


def counted(robots: int) -> Counted:
    """Run so many robots in memory."""
    changes = [*OVERRIDES, *WORLD, *SMALL, ("tasks", tasks_of("toy", robots)), ("federation.max_rounds", ROUNDS)]
    scenario = load_scenario("toy", changes)
    begun_s = time.process_time()
    outcome = run_in_memory(scenario)
    wire = [row for row in outcome.hub.meter.rows() if row.direction in ("in", "out")]
    return Counted(
        rows=len(outcome.rows),
        messages=sum(row.messages for row in wire),
        wire_bytes=sum(row.packet_bytes for row in wire),
        cpu_s=time.process_time() - begun_s,
        peak_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    )


def check(robots: int) -> None:
    """Print what was foretold and what was counted."""
    use_one_thread()
    few, many = counted(FEW), counted(robots)
    for what in ("rows", "messages", "wire_bytes"):
        foretold, found = getattr(few, what) / FEW * robots, getattr(many, what)
        print(f"{what}: {FEW} robots {getattr(few, what):,}; {robots:,} foretold {foretold:,.0f}, counted {found:,}: "
              f"ratio {found / foretold:.5f}")  # fmt: skip
    per = 1e3 / ROUNDS
    print(
        f"CPU a robot-round {few.cpu_s / FEW * per:.0f} ms and {many.cpu_s / robots * per:.0f} ms, its start and all; "
        f"{many.peak_mb:.0f} MB at most"
    )


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--robots", type=int, nargs="+", default=[10**3, 10**4, 10**5, 10**6])
    known.add_argument("--seconds", type=float, default=PAPER_SECONDS, help="of a robot's round")
    known.add_argument("--check", type=int, metavar="ROBOTS", help=f"a multiple of {CLUSTER}, in memory")
    options = known.parse_args()
    if options.check is None:
        table(options.robots, options.seconds)
    elif options.check < CLUSTER or options.check % CLUSTER:
        known.error(f"--check {options.check}: expected a multiple of {CLUSTER}, the robots of a cluster")
    else:
        check(options.check)


if __name__ == "__main__":
    main()
