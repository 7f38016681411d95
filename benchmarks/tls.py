"""One large message to one subscriber by the embedded broker, with access control (TLS, users, rights) and without.

    python -m benchmarks.tls [--rounds 40]

Sender and receiver are two clients of one process. Each round measures both brokers one after the other.
"""

from __future__ import annotations

import os
import tempfile
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

from benchmarks.broker_throughput import WEIGHTS_BYTES
from benchmarks.harness import compare, embedded, in_turn, parser, seconds
from jouleswarm.common.bus.credentials import Credentials, credentials_of
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire import topics
from jouleswarm.fleet.keys import make_keys

TOPIC = topics.weights("bench", "fl", 1, 1)
WARM_UP = 3


class Pair:
    """Robot 1, who sends, and robot 2, who receives."""

    def __init__(self, url: str, keys: Path | None, stack: ExitStack) -> None:
        def connect(client: str) -> MqttBus:
            credentials: Credentials | None = credentials_of(keys, client)
            return stack.enter_context(closing(MqttBus.connect(url, client, credentials=credentials)))

        self._sender, self._receiver = connect("agent-1"), connect("agent-2")
        self._receiver.subscribe(TOPIC)

    def seconds(self, payload: bytes) -> float:
        """From the word to send until the message has been received."""
        return seconds(lambda: (self._sender.publish(TOPIC, payload), self._receiver.receive()))


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--rounds", type=int, default=40)
    rounds = known.parse_args().rounds
    payload = os.urandom(WEIGHTS_BYTES)
    with ExitStack() as stack:
        keys = Path(stack.enter_context(tempfile.TemporaryDirectory()), "keys")
        make_keys(load_scenario(Path("scenarios/toy.toml")), keys, ["127.0.0.1", "localhost"], days=1)
        guarded = stack.enter_context(embedded("--keys", str(keys)))
        plain = stack.enter_context(embedded())
        pairs = {"with access control": Pair(guarded.url, keys, stack), "without": Pair(plain.url, None, stack)}
        found = in_turn({name: partial(pair.seconds, payload) for name, pair in pairs.items()}, rounds, WARM_UP)
    print(compare(f"{WEIGHTS_BYTES / 1e6:.2f} MB to one subscriber", found))


if __name__ == "__main__":
    main()
