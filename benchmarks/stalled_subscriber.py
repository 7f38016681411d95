"""How long 12 honest robots wait because of one subscriber that reads nothing, and what the broker holds meanwhile.

    python -m benchmarks.stalled_subscriber [--rounds 8] [--pressed-s 10] [--stall-s 60]

Robots on a ring exchange weights of 5.6 MB in rounds; the stalled one is subscribed to all of them. --pressed-s 60 is
the rule without a shorter time for who holds more than its share.
"""

from __future__ import annotations

import socket
import threading
import time

import psutil

from benchmarks.broker_throughput import ROBOTS, RUN, Crew, ring_robot
from benchmarks.harness import MEGABYTE, embedded, parser
from fuzz.hostile_packets import connect, subscribe
from jouleswarm.common.bus.address import parse_url


def peak_watch(process: psutil.Process, peak: list[int], stop: threading.Event) -> None:
    """Keep the most memory seen."""
    while not stop.wait(0.1):
        peak[0] = max(peak[0], process.memory_info().rss)


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--rounds", type=int, default=8)
    known.add_argument("--pressed-s", type=float, default=10.0)
    known.add_argument("--stall-s", type=float, default=60.0)
    options = known.parse_args()
    times = ("--pressed-stall-timeout-s", str(options.pressed_s), "--stall-timeout-s", str(options.stall_s))
    with embedded(*times) as broker, socket.socket() as stalled:
        crew = Crew([(ring_robot, (broker.url, number, ROBOTS)) for number in range(ROBOTS)])
        address, process = parse_url(broker.url), psutil.Process(broker.pid)
        before, peak, stop = process.memory_info().rss, [0], threading.Event()
        watcher = threading.Thread(target=peak_watch, args=(process, peak, stop))
        watcher.start()
        stalled.connect((address.host, address.port))
        stalled.sendall(connect("stalled", keepalive_s=0) + subscribe(f"{RUN}/#", qos=0))
        begun_s = time.monotonic()
        rounds_s = [crew.round_s(lambda: None) for _ in range(options.rounds)]
        total_s = time.monotonic() - begun_s
        stop.set()
        watcher.join()
        crew.end(answers=True)
    print(
        f"{options.rounds} rounds of {ROBOTS} robots in {total_s:.1f} s: "
        + " ".join(f"{each:.1f}" for each in rounds_s)
    )
    print(f"longest round {max(rounds_s):.1f} s; the broker grew by {(peak[0] - before) / MEGABYTE:.0f} MB at its peak")


if __name__ == "__main__":
    main()
