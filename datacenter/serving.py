"""Methods in which the data center takes part in every round: clusters come round by round, each at its own pace."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from jouleswarm.common.bus.identity import Identity
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.bus.reporter import Reporter
from jouleswarm.common.disk.state import State
from jouleswarm.common.meter.work import TallyOf
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.datacenter.central import CentralLearner
from jouleswarm.datacenter.checkpoint import Checkpoint
from jouleswarm.datacenter.cluster_rounds import ClusterDesk, Service
from jouleswarm.datacenter.parameter_server import ParameterServer

SERVICES: dict[str, Callable[[Scenario, Path | None, TallyOf], Service[Any]]] = {
    "fedavg": ParameterServer,
    "centralized": CentralLearner,
}


def serve(
    scenario: Scenario,
    method: str,
    run: str,
    listener: Listener,
    identity: Identity,
    reporter: Reporter,
    checkpoint: Checkpoint,
) -> None:
    """Serve all clusters, whichever round of whichever is complete first, until every robot is done."""
    service = SERVICES[method](scenario, checkpoint.folder, partial(listener.bus.meter.tally, "fl", method))
    opened = 2 * scenario.arm_names.index(method) + 1
    desk = ClusterDesk(listener, scenario, run, method, service, done=opened + 1)
    for task in scenario.clusters:
        if found := checkpoint.load(f"task-{task}"):
            service.load_state(task, found[1].part("service"))
            desk.load_state(task, found[1].part("desk"))
    desk.listen()
    # Robots wait for this: what they sent up before there was anybody to hear it would be lost.
    identity.announce(opened)
    while (turn := desk.next_round()) is not None:
        begun = time.monotonic()
        payload, gradients = service.model(turn)
        desk.answer(turn, payload)
        if gradients:
            reporter.row(
                RoundRow(
                    phase="fl",
                    arm=method,
                    task=turn.task,
                    agent=0,
                    round=turn.round,
                    gradients=gradients,
                    refused=desk.refused,
                    seconds=round(time.monotonic() - begun, 4),
                )
            )
        if checkpoint.folder is not None:
            state = State.of({"service": service.state(turn.task), "desk": desk.state(turn.task)})
            checkpoint.save(turn.round, state, f"task-{turn.task}")
        # Robots forget a round's experience when they have its model.
        desk.send(turn.task)
    checkpoint.finish()
    desk.leave()
