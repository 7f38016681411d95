"""A learner: `python learner.py NUMBER PORT`. Least squares by gradient descent on data of its own.

After each round its model is averaged with the others', by the parameter server or among neighbours. Prints the error
of the last model on its data, of each encoding by the server and then by consensus.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from payloads import ENCODINGS, FEATURES, OUTPUTS, Encoding, Tensors
from wire import BATCHES, CONSENSUS, LEARNERS, POST, ROUNDS, SERVER, Client

from jouleswarm import Meter

SAMPLES, STEP = 128, 0.4
Exchange = Callable[[Tensors, bytes], Tensors]
"""Own model, and it as bytes -> the average."""


def main(number: int, port: int) -> None:
    me = f"learner-{number}"
    neighbours = [f"+/{CONSENSUS}/learner-{each}" for each in LEARNERS if each != number]
    client = Client(me, port, f"+/{SERVER}", *neighbours)
    truth = np.random.default_rng(0).normal(size=(FEATURES, OUTPUTS))
    noise = np.random.default_rng(number)
    x = noise.normal(size=(SAMPLES, FEATURES)).astype(np.float32)
    y = (x @ truth + 0.1 * noise.normal(size=(SAMPLES, OUTPUTS))).astype(np.float32)
    for name, encoding in ENCODINGS.items():
        meter = Meter(me, broker=f"mqtt://127.0.0.1:{port}", arm=name)
        for exchange in (by_server, by_consensus):
            model = learn(number, exchange(client, number, name, encoding), encoding, meter, x, y)
            print(f"{np.mean((x @ model['weight'] + model['bias'] - y) ** 2):.4f}", flush=True)
        meter.close()
    client.close()


def learn(me: int, exchange: Exchange, encoding: Encoding, meter: Meter, x: np.ndarray, y: np.ndarray) -> Tensors:
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
            model = exchange(own, payload)
        bias, weight = model["bias"], model["weight"]
    return model


def by_server(client: Client, me: int, name: str, encoding: Encoding) -> Exchange:
    def exchange(own: Tensors, payload: bytes) -> Tensors:
        client.publish(f"{name}/{POST}", payload)
        return encoding.decode(client.take(f"{name}/{SERVER}"))

    return exchange


def by_consensus(client: Client, me: int, name: str, encoding: Encoding) -> Exchange:
    def exchange(own: Tensors, payload: bytes) -> Tensors:
        client.publish(f"{name}/{CONSENSUS}/learner-{me}", payload)
        others = [f"{name}/{CONSENSUS}/learner-{each}" for each in LEARNERS if each != me]
        every = [own, *(encoding.decode(client.take(topic)) for topic in others)]
        return {key: np.mean([each[key] for each in every], axis=0) for key in ("bias", "weight")}

    return exchange


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
