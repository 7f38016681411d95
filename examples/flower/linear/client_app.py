"""A client: gradient steps on data of its own."""

import numpy as np
from flwr.app import ArrayRecord, Context, Message, MetricRecord, RecordDict
from flwr.clientapp import ClientApp

from jouleswarm.flower import gradients, meter_mod

app = ClientApp(mods=[meter_mod])


def load(context: Context) -> tuple[np.ndarray, np.ndarray]:
    """32 examples: x [32, features], y [32, 10]; the truth is the same for all clients."""
    features = int(context.run_config["features"])
    rng = np.random.default_rng(1 + int(context.node_config["partition-id"]))
    x = rng.normal(size=(32, features)).astype(np.float32)
    truth = np.random.default_rng(0).normal(size=(features, 10)).astype(np.float32)
    return x, x @ truth


@app.train()
def train(message: Message, context: Context) -> Message:
    weights, bias = message.content["arrays"].to_numpy_ndarrays()
    x, y = load(context)
    steps = int(context.run_config["steps"])
    for _ in range(steps):
        error = (x @ weights + bias - y) / len(x)
        weights = weights - 0.1 * x.T @ error / x.shape[1] ** 0.5
        bias = bias - 0.1 * error.sum(axis=0)
    gradients(steps)
    metrics = MetricRecord({"num-examples": len(x)})
    return Message(RecordDict({"arrays": ArrayRecord([weights, bias]), "metrics": metrics}), reply_to=message)


@app.evaluate()
def evaluate(message: Message, context: Context) -> Message:
    weights, bias = message.content["arrays"].to_numpy_ndarrays()
    x, y = load(context)
    metrics = MetricRecord({"num-examples": len(x), "mse": float(np.mean((x @ weights + bias - y) ** 2))})
    return Message(RecordDict({"metrics": metrics}), reply_to=message)
