"""The server: federated averaging, metered."""

import numpy as np
from flwr.app import ArrayRecord, Context
from flwr.serverapp import Grid, ServerApp
from flwr.serverapp.strategy import FedAvg

from jouleswarm.flower import metered

app = ServerApp()


@app.main()
def main(grid: Grid, context: Context) -> None:
    features, rounds = int(context.run_config["features"]), int(context.run_config["rounds"])
    model = ArrayRecord([np.zeros((features, 10), np.float32), np.zeros(10, np.float32)])
    strategy = metered(FedAvg(min_available_nodes=2))
    strategy.start(grid, model, num_rounds=rounds)
