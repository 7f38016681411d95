"""Topics, and a plain MQTT client of paho-mqtt that keeps what it receives until it is taken."""

from __future__ import annotations

import itertools
import queue
import threading

import paho.mqtt.client as mqtt
from payloads import ENCODINGS

POST, SERVER, CONSENSUS = "post model", "PS", "consensus"
"""From learners to the parameter server, its answer to all of them, and between learners."""
LEARNERS, ROUNDS, BATCHES = (1, 2), 5, 4
ARMS = [(mode, encoding) for mode, encoding in itertools.product((SERVER, CONSENSUS), ENCODINGS)]
"""What is compared, one after the other: who averages, and how models travel."""
_PATIENCE_S = 60.0


class Client:
    """Connected and subscribed when it is made."""

    def __init__(self, name: str, port: int, *topics: str) -> None:
        self._inbox: dict[str, queue.Queue[bytes]] = {topic: queue.Queue() for topic in topics}
        subscribed = threading.Event()
        self._client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, name)
        self._client.on_subscribe = lambda *_: subscribed.set()
        self._client.on_message = lambda _client, _data, message: self._inbox[message.topic].put(message.payload)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        self._client.subscribe([(topic, 1) for topic in topics])
        if not subscribed.wait(_PATIENCE_S):
            raise TimeoutError(f"{name}: no answer to its subscriptions")

    def publish(self, topic: str, payload: bytes) -> None:
        self._client.publish(topic, payload, qos=1).wait_for_publish(_PATIENCE_S)

    def take(self, topic: str) -> bytes:
        """The next message there; raises queue.Empty if there is none within a minute."""
        return self._inbox[topic].get(timeout=_PATIENCE_S)

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()
