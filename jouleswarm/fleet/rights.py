"""Who may publish and read what: the rights of every client of a scenario, as a Mosquitto acl_file.

A right holds for every run and arm. The broker itself needs none: nobody may write its meter.
"""

from __future__ import annotations

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.names import client_of

Right = tuple[str, str]  # read or write, and a topic filter

DATACENTER, RECORDER, HEALTH = "datacenter", "recorder", "health"
_RUN = _ARM = _ANY = "+"

_SCENARIO = [
    ("write", topics.scenario(_RUN, topics.SHARED)),
    ("read", topics.scenario(_RUN, topics.SHARED)),
    ("read", topics.scenario(_RUN, topics.RECORDER)),
]
"""Without a recorder any process may be the first to say what the run's scenario is; with one it alone says so."""


def rights_of(scenario: Scenario) -> dict[str, list[Right]]:
    """The rights of each client: the robots, the data center, the recorder, and one that may only connect."""
    robots = {client_of(agent): robot_rights(scenario, agent) for agent in scenario.agents}
    return {**robots, DATACENTER: datacenter_rights(), RECORDER: recorder_rights(), HEALTH: []}


def robot_rights(scenario: Scenario, agent: int) -> list[Right]:
    """A robot publishes under its own id, asks neighbours and data center to send again, reads its own cluster."""
    task = scenario.task_of(agent)
    rights = [
        ("write", topics.presence(_RUN, task, agent)),
        *_claims(task, agent),
        ("write", topics.weights(_RUN, _ARM, task, agent)),
        ("write", topics.weights_up(_RUN, _ARM, task, agent)),
        ("write", topics.experience(_RUN, _ARM, task, agent)),
        ("write", topics.transition(_RUN, _ARM, task, agent)),
        ("write", topics.episode(_RUN, _ARM, task, agent)),
        ("write", topics.resend(_RUN, _ARM, task, _ANY)),
        ("write", topics.model_again(_RUN, _ARM, task)),
        ("write", topics.meta_resend(_RUN, _ARM)),
        *_reports(f"agent-{agent}"),
        *_SCENARIO,
        ("read", topics.presence(_RUN, task, _ANY)),
        ("read", topics.presence(_RUN, 0, 0)),
        ("read", topics.weights(_RUN, _ARM, task, _ANY)),
        ("read", topics.episode(_RUN, _ARM, task, _ANY)),
        ("read", topics.resend(_RUN, _ARM, task, agent)),
        ("read", topics.collect_again(_RUN, _ARM, task, agent)),
        ("read", topics.cluster_model(_RUN, _ARM, task)),
        ("read", topics.meta_model(_RUN, _ARM)),
        ("read", topics.meta_model(_RUN, _ARM, agent)),
        ("read", topics.meta_round(_RUN, _ARM)),
        ("read", topics.BROKER_LIMITS),
    ]
    if agent == min(scenario.cluster(task)) or scenario.federation.on_missing == "proceed":
        rights.append(("write", topics.learned(_RUN, _ARM, task)))
    return rights


def datacenter_rights() -> list[Right]:
    """The data center alone sends models down and says which rounds it wants; it reads the uplink."""
    return [
        ("write", topics.presence(_RUN, 0, 0)),
        *_claims(0, 0),
        ("write", topics.meta_model(_RUN, _ARM)),
        ("write", topics.meta_model(_RUN, _ARM, _ANY)),
        ("write", topics.cluster_model(_RUN, _ARM, _ANY)),
        ("write", topics.meta_round(_RUN, _ARM)),
        ("write", topics.resend(_RUN, _ARM, _ANY, _ANY)),
        ("write", topics.collect_again(_RUN, _ARM, _ANY, _ANY)),
        ("write", topics.snapshot(_RUN, _ARM, _ANY)),
        *_reports(DATACENTER),
        *_SCENARIO,
        ("read", topics.presence(_RUN, _ANY, _ANY)),
        ("read", topics.experience(_RUN, _ARM, _ANY, _ANY)),
        ("read", topics.transition(_RUN, _ARM, _ANY, _ANY)),
        ("read", topics.weights_up(_RUN, _ARM, _ANY, _ANY)),
        ("read", topics.model_again(_RUN, _ARM, _ANY)),
        ("read", topics.meta_resend(_RUN, _ARM)),
        ("read", topics.BROKER_LIMITS),
    ]


def recorder_rights() -> list[Right]:
    """The recorder reads what is reported, says what the scenario is, and asks the broker for its counters.

    What it says to itself goes by the broker too.
    """
    return [
        ("write", topics.recorder(_RUN)),
        ("write", topics.scenario(_RUN, topics.RECORDER)),
        ("write", topics.scenario(_RUN, topics.SHARED)),
        ("write", topics.acknowledgement(_RUN, _ANY)),
        ("write", topics.probe(_RUN)),
        ("read", topics.probe(_RUN)),
        ("read", topics.acknowledgement(_RUN, RECORDER)),
        *_waits(topics.RECORDER),
        ("read", topics.telemetry(_RUN, _ARM, _ANY)),
        ("read", topics.learned(_RUN, _ARM, _ANY)),
        ("read", topics.snapshot(_RUN, _ARM, _ANY)),
        ("read", topics.meter_report(_RUN, _ANY)),
        ("read", topics.presence(_RUN, _ANY, _ANY)),
        ("write", topics.presence(_RUN, _ANY, _ANY)),  # it removes those of who is done
        ("read", topics.BROKER_METER),
        ("read", topics.broker_answer(_ANY)),
        ("read", topics.BROKER_LIMITS),
        ("write", topics.BROKER_METER_ASK),
    ]


def rights_file(rights: dict[str, list[Right]]) -> str:
    """The text of the file."""
    lines = ["# Topic rights, in the format of Mosquitto's acl_file. What is not permitted here is forbidden."]
    for client, own in rights.items():
        lines += ["", f"user {client}", *(f"topic {access} {topic}" for access, topic in own)]
    return "\n".join(lines) + "\n"


def _reports(client: str) -> list[Right]:
    """What is told to the recorder, and its answers."""
    return [
        ("write", topics.telemetry(_RUN, _ARM, client)),
        ("write", topics.meter_report(_RUN, client)),
        ("read", topics.acknowledgement(_RUN, client)),
        ("read", topics.recorder(_RUN)),
        *_waits(client),
    ]


def _waits(client: str) -> list[Right]:
    """Whoever waits asks whom it waits for, and is asked."""
    return [("write", topics.wait(_RUN, _ANY)), ("read", topics.wait(_RUN, client))]


def _claims(task: int, agent: int) -> list[Right]:
    """A process claims to be a robot, and hears who else does."""
    return [("write", topics.claim(_RUN, task, agent)), ("read", topics.claim(_RUN, task, agent))]
