"""How a process of a run begins: alone with its folder, on the processor it had, its counters kept, on the bus."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from jouleswarm.common.allocator import keep_freed_memory
from jouleswarm.common.bus.address import parse_url
from jouleswarm.common.bus.credentials import credentials_of
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.errors import usable
from jouleswarm.common.host import same_arithmetic
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.options import Started
from jouleswarm.common.process import ROUNDS_LOG, use_one_thread
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Presence, encode_json
from jouleswarm.common.wire.names import client_of

log = logging.getLogger(ROUNDS_LOG)


def join(
    scenario: Scenario,
    agent: int,
    started: Started,
    arithmetic: Callable[[], str],
    verify: Callable[[Path], None] = lambda folder: None,
) -> tuple[str, MqttBus]:
    """Join a run as robot `agent` (0: the data center); returns the run's name on the bus, and the bus.

    Args:
        scenario: of the run.
        agent: which process this is.
        started: what it was started with.
        arithmetic: what it computes on; asked once it computes in one thread.
        verify: looks through the folder before anything else is done with it.

    Raises:
        ConfigurationError: the folder is another process's at this moment, or from another processor; or the broker
            refuses the client.
        BrokerUnreachableError: no broker answered in time.
        RunError: what the folder holds is not as it was written.
    """
    state, client = started.state, client_of(agent)
    if state is not None:
        Lock(state, f"robot {agent}" if agent else "data center")  # until the process ends
        verify(state)
    use_one_thread()
    same_arithmetic(state, arithmetic(), other_processor=started.other_processor)
    keep_freed_memory()
    patience_s = scenario.bus.connect_timeout_s
    name, task = topics.run_name(started.run or scenario.name), scenario.task_of(agent) if agent else 0
    with usable("--state", state):
        meter = Meter("client", state)
    log.info("joining run %s at %s; a broker may take up to %g s to come", name, parse_url(started.broker), patience_s)
    bus = MqttBus.connect(
        started.broker,
        client,
        credentials=credentials_of(started.keys, client),
        will=(topics.presence(name, task, agent), encode_json(Presence(agent=agent, state="gone"))),
        keepalive_s=scenario.bus.keepalive_s,
        connect_timeout_s=patience_s,
        meter=meter,
    )
    return name, bus
