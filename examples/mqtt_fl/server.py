"""The parameter server: `python server.py PORT FILE`. Averages what learners post, and publishes it to all of them."""

from __future__ import annotations

import sys

import numpy as np
from payloads import ENCODINGS
from wire import ARMS, LEARNERS, POST, ROUNDS, SERVER, Client

from jouleswarm import Meter


def main(port: int, file: str) -> None:
    client = Client("server", port, POST)
    print("ready", flush=True)
    for mode, name in ARMS:
        if mode == SERVER:
            serve(client, name, Meter("server", role="server", file=file, arm=f"{mode}, {name}"))
    client.close()


def serve(client: Client, encoding: str, meter: Meter) -> None:
    encode, decode = ENCODINGS[encoding]
    for number in range(ROUNDS):
        posted = []
        for _ in LEARNERS:
            payload = client.take(POST)
            posted.append(decode(payload))
            meter.received("uplink", len(payload), sender=f"learner-{posted[-1]['from'][0]}")
        with meter.phase("average", round=number):
            bias, weight = (np.mean([each[key] for each in posted], axis=0) for key in ("bias", "weight"))
        payload = encode({"bias": bias, "from": np.array([0, number], np.int32), "weight": weight})
        client.publish(SERVER, payload)  # one message up to the broker, one down to each learner
        for learner in LEARNERS:
            meter.sent("downlink", len(payload), to=f"learner-{learner}")
    meter.close()


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2])
