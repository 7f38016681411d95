"""A ring of 4 robots exchanges paper-size weights at QoS 1 with both neighbours, without training.

    python -m benchmarks.ring_exchange [--rounds 40] [--mosquitto]

Prints the seconds a round (from the word to begin until every robot has both neighbours' weights), and the wire
bytes per model byte and hop: all MQTT packets of both directions, acknowledgements included, over payload bytes.
"""

from __future__ import annotations

import os
import statistics
from multiprocessing.connection import Connection

from benchmarks.broker_throughput import WEIGHTS_BYTES, Crew
from benchmarks.harness import embedded, mosquitto, parser
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.wire import topics

ROBOTS = 4
PUBACK_BYTES = 4


def robot(url: str, number: int, pipe: Connection) -> None:
    """Each round: publish the own weights, take both neighbours'. At the end says what its meter counted."""
    bus = MqttBus.connect(url, f"agent-{number}")
    neighbours = ((number + 1) % ROBOTS, (number - 1) % ROBOTS)
    bus.subscribe(*(topics.weights("ring", "maml", 1, neighbour) for neighbour in neighbours))
    weights = os.urandom(WEIGHTS_BYTES)
    pipe.send("ready")
    while pipe.recv():
        bus.publish(topics.weights("ring", "maml", 1, number), weights)
        for _ in neighbours:
            message = bus.receive()
            assert message is not None
            assert len(message.payload) == WEIGHTS_BYTES
        pipe.send("done")
    bus.close()
    rows = bus.meter.rows()
    wire_bytes = sum(row.packet_bytes + PUBACK_BYTES * row.messages for row in rows)
    pipe.send((wire_bytes, sum(row.payload_bytes for row in rows)))


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--rounds", type=int, default=40)
    known.add_argument("--mosquitto", action="store_true", help="over Mosquitto in place of the embedded broker")
    options = known.parse_args()
    with mosquitto() if options.mosquitto else embedded() as broker:
        crew = Crew([(robot, (broker.url, number)) for number in range(ROBOTS)])
        seconds = [crew.round_s(lambda: None) for _ in range(options.rounds + 1)][1:]
        wire_bytes, payload_bytes = map(sum, zip(*crew.end(answers=True), strict=True))
    print(f"a round: median {statistics.median(seconds):.3f} s, slowest {max(seconds):.3f} s (goal: 0.35 s)")
    print(f"wire bytes per model byte and hop: {wire_bytes / payload_bytes:.6f} (goal: 1.005)")


if __name__ == "__main__":
    main()
