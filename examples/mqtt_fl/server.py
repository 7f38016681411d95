"""The parameter server: `python server.py PORT`. Averages what learners post, and publishes it to all of them."""

from __future__ import annotations

import sys

import numpy as np
from payloads import ENCODINGS
from wire import LEARNERS, POST, ROUNDS, SERVER, Client


def main(port: int) -> None:
    client = Client("server", port, f"+/{POST}")
    print("ready", flush=True)
    for name in ENCODINGS:
        serve(client, name)
    client.close()


def serve(client: Client, name: str) -> None:
    encode, decode = ENCODINGS[name]
    for number in range(ROUNDS):
        posted = [decode(client.take(f"{name}/{POST}")) for _ in LEARNERS]
        bias, weight = (np.mean([each[key] for each in posted], axis=0) for key in ("bias", "weight"))
        payload = encode({"bias": bias, "from": np.array([0, number], np.int32), "weight": weight})
        client.publish(f"{name}/{SERVER}", payload)  # one message up to the broker, one down to each learner


if __name__ == "__main__":
    main(int(sys.argv[1]))
