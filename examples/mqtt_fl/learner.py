"""A learner: `python learner.py NUMBER PORT FILE`. Least squares by gradient descent on data of its own.

After each round its model is averaged with the others', by the parameter server or among neighbours. Prints the error
of each arm's last model on its data.
"""

from __future__ import annotations

import sys

import numpy as np
from payloads import ENCODINGS, FEATURES, OUTPUTS, Encoding, Tensors
from wire import ARMS, BATCHES, CONSENSUS, LEARNERS, POST, ROUNDS, SERVER, Client

from jouleswarm import Meter

SAMPLES, STEP = 128, 0.4


def main(number: int, port: int, file: str) -> None:
    client = Client(f"learner-{number}", port, SERVER, CONSENSUS)
    truth = np.random.default_rng(0).normal(size=(FEATURES, OUTPUTS))
    noise = np.random.default_rng(number)
    x = noise.normal(size=(SAMPLES, FEATURES)).astype(np.float32)
    y = (x @ truth + 0.1 * noise.normal(size=(SAMPLES, OUTPUTS))).astype(np.float32)
    for mode, name in ARMS:
        meter = Meter(f"learner-{number}", role="robot", file=file, arm=f"{mode}, {name}")
        model = learn(client, number, mode, ENCODINGS[name], meter, x, y)
        print(f"{np.mean((x @ model['weight'] + model['bias'] - y) ** 2):.4f}", flush=True)
        meter.close()
    client.close()


def learn(
    client: Client, me: int, mode: str, encoding: Encoding, meter: Meter, x: np.ndarray, y: np.ndarray
) -> Tensors:
    exchange = by_server if mode == SERVER else by_consensus
    bias, weight = np.zeros(OUTPUTS, np.float32), np.zeros((FEATURES, OUTPUTS), np.float32)
    for number in range(ROUNDS):
        with meter.phase("train", round=number):
            for batch in np.array_split(np.arange(SAMPLES), BATCHES):
                error = x[batch] @ weight + bias - y[batch]
                bias, weight = bias - STEP * error.mean(axis=0), weight - STEP / len(batch) * x[batch].T @ error
            meter.gradients(BATCHES)
        with meter.phase("encode", round=number):
            own = {"bias": bias, "from": np.array([me, number], np.int32), "weight": weight}
            payload = encoding.encode(own)
        with meter.phase("exchange", round=number):
            model = exchange(client, encoding, meter, own, payload)
        bias, weight = model["bias"], model["weight"]
    return model


def by_server(client: Client, encoding: Encoding, meter: Meter, own: Tensors, payload: bytes) -> Tensors:
    client.publish(POST, payload)
    meter.sent("uplink", len(payload))
    answer = client.take(SERVER)
    meter.received("downlink", len(answer))
    return encoding.decode(answer)


def by_consensus(client: Client, encoding: Encoding, meter: Meter, own: Tensors, payload: bytes) -> Tensors:
    client.publish(CONSENSUS, payload)
    me, theirs = own["from"][0], []
    for _ in LEARNERS:  # its own message too comes to whoever has subscribed to the topic, and is no neighbour's
        answer = client.take(CONSENSUS)
        found = encoding.decode(answer)
        if (sender := found["from"][0]) != me:
            theirs.append(found)
            meter.sent("sidelink", len(payload), to=f"learner-{sender}")
            meter.received("sidelink", len(answer), sender=f"learner-{sender}")
    return {key: np.mean([each[key] for each in (own, *theirs)], axis=0) for key in ("bias", "weight")}


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
