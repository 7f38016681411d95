"""Topics, and a plain MQTT client of paho-mqtt that keeps what it receives until it is taken."""

from __future__ import annotations

import queue
import threading

import paho.mqtt.client as mqtt

POST, SERVER, CONSENSUS = "post model", "PS", "consensus"
"""From learners to the parameter server, its answer to all of them, and between learners (with the sender's name after
it). Before each stands the encoding: links.toml says which link they go over."""
LEARNERS, ROUNDS, BATCHES = (1, 2), 5, 4
_PATIENCE_S = 60.0


class Client:
    """Connected and subscribed when it is made."""

    def __init__(self, name: str, port: int, *filters: str) -> None:
        self._inbox: dict[str, queue.Queue[bytes]] = {}
        subscribed = threading.Event()
        self._client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, name)
        self._client.on_subscribe = lambda *_: subscribed.set()
        self._client.on_message = lambda _client, _data, message: self._of(message.topic).put(message.payload)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        self._client.subscribe([(each, 1) for each in filters])
        if not subscribed.wait(_PATIENCE_S):
            raise TimeoutError(f"{name}: no answer to its subscriptions")

    def publish(self, topic: str, payload: bytes) -> None:
        self._client.publish(topic, payload, qos=1).wait_for_publish(_PATIENCE_S)

    def take(self, topic: str) -> bytes:
        """The next message there; raises queue.Empty if there is none within a minute."""
        return self._of(topic).get(timeout=_PATIENCE_S)

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def _of(self, topic: str) -> queue.Queue[bytes]:
        return self._inbox.setdefault(topic, queue.Queue())
