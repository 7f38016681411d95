"""A ring of 4 robots exchanges paper-size weights at QoS 1 with both neighbours, without training.

    python -m benchmarks.ring_exchange [--rounds 40] [--mosquitto]

Prints the seconds a round (from the word to begin until every robot has both neighbours' weights), and the wire
bytes per model byte and hop: all MQTT packets of both directions, acknowledgements included, over payload bytes.
"""

from __future__ import annotations

import statistics

from benchmarks.broker_throughput import Crew, ring_robot
from benchmarks.harness import embedded, mosquitto, parser

ROBOTS = 4


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--rounds", type=int, default=40)
    known.add_argument("--mosquitto", action="store_true", help="over Mosquitto in place of the embedded broker")
    options = known.parse_args()
    with mosquitto() if options.mosquitto else embedded() as broker:
        crew = Crew([(ring_robot, (broker.url, number, ROBOTS)) for number in range(ROBOTS)])
        seconds = [crew.round_s(lambda: None) for _ in range(options.rounds + 1)][1:]
        wire_bytes, payload_bytes = map(sum, zip(*crew.end(answers=True), strict=True))
    print(f"a round: median {statistics.median(seconds):.3f} s, slowest {max(seconds):.3f} s (goal: 0.35 s)")
    print(f"wire bytes per model byte and hop: {wire_bytes / payload_bytes:.6f} (goal: 1.005)")


if __name__ == "__main__":
    main()
