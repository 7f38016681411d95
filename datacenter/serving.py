"""Methods in which the data center takes part in every round: clusters come round by round, each at its own pace."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from common import topics
from common.bus import Bus
from common.payloads import Presence, encode_json
from common.reports import publish_row
from common.runlog import RoundRow
from common.scenario import Scenario
from datacenter.central import CentralLearner
from datacenter.cluster_desk import ClusterDesk, Service
from datacenter.parameter_server import ParameterServer

SERVICES: dict[str, Callable[[Scenario], Service[Any]]] = {"fedavg": ParameterServer, "centralized": CentralLearner}


def serve(scenario: Scenario, method: str, run: str, bus: Bus) -> None:
    """Serve all clusters, whichever round of whichever is complete first, until every robot is done."""
    service, opened = SERVICES[method](scenario), 2 * scenario.arm_names.index(method) + 1
    desk = ClusterDesk(bus, scenario, run, method, service, done=opened + 1)
    desk.listen()
    # Robots wait for this: what they sent up before there was anybody to hear it would be lost.
    bus.publish(topics.presence(run, 0, 0), encode_json(Presence(agent=0, stage=opened)), retain=True)
    while (turn := desk.next_round()) is not None:
        begun = time.monotonic()
        payload, gradients = service.model(turn)
        desk.answer(turn, payload)
        if gradients:
            row = RoundRow(
                phase="fl",
                arm=method,
                task=turn.task,
                agent=0,
                round=turn.round,
                gradients=gradients,
                refused=desk.refused,
                seconds=round(time.monotonic() - begun, 4),
            )
            publish_row(bus, run, row)
    desk.leave()
