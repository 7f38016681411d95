"""The only place where topic strings are made and read.

``jouleswarm/<run>/<arm>/<link>/...`` with link one of ul, dl, sl, ctl, tlm. The arm is a level of the
topic so that per-topic byte counters need no further knowledge to be priced arm by arm. Which link class each is priced
as, links.toml says.
"""

from __future__ import annotations

import re
from enum import StrEnum

from jouleswarm.common.errors import ConfigurationError

ROOT = "jouleswarm"

Level = int | str  # an id, or "+" in a filter

SHARED = "all"  # the arm level of control traffic that serves every arm

DATACENTER, RECORDER = "datacenter", "recorder"  # plain names of clients

# What the broker tells: its totals and its limits (both retained, see `wire.broker_counters`); and the question
# for a run's counters. A report cannot count itself, so neither these nor `broker_answer` and `meter_report` are
# ever metered.
BROKER_METER = f"$SYS/{ROOT}/meter"
BROKER_LIMITS = f"$SYS/{ROOT}/limits"
BROKER_METER_ASK = f"{ROOT}/meter/ask"


class Link(StrEnum):
    """The link class that a topic's bytes are priced as."""

    UPLINK = "uplink"
    DOWNLINK = "downlink"
    SIDELINK = "sidelink"
    CONTROL = "control"


_LONGEST_RUN = 128  # it is the name of a folder too
_RUN = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*")


def run_name(name: str) -> str:
    """`name`, if it can be a level of a topic and a directory.

    Raises:
        ConfigurationError: it cannot.
    """
    if not _RUN.fullmatch(name) or len(name) > _LONGEST_RUN:
        shown = name if len(name) <= _LONGEST_RUN else f"{name[:40]}... of {len(name)} letters"
        raise ConfigurationError(
            f"run name {shown!r}: expected letters, digits, _ - and ., not beginning with ., {_LONGEST_RUN} at most"
        )
    return name


def experience(run: str, arm: str, task: Level, agent: Level) -> str:
    """Raw observations of one training robot, one message a motion, before the arm's own rounds."""
    return f"{ROOT}/{run}/{arm}/ul/{task}/{agent}/experience"


def transition(run: str, arm: str, task: Level, agent: Level) -> str:
    """Raw observations of a robot whose task the data center learns, one message a motion (centralized)."""
    return f"{ROOT}/{run}/{arm}/ul/{task}/{agent}/transition"


def meta_model(run: str, arm: str, agent: Level | None = None) -> str:
    """The meta-model, from the data center to every robot, or to one that missed it."""
    return f"{ROOT}/{run}/{arm}/dl/meta" if agent is None else f"{ROOT}/{run}/{arm}/dl/{agent}/meta"


def weights(run: str, arm: str, task: Level, agent: Level) -> str:
    """A robot's weights of one round, to its neighbours."""
    return f"{ROOT}/{run}/{arm}/sl/{task}/{agent}/weights"


def weights_up(run: str, arm: str, task: Level, agent: Level) -> str:
    """A robot's weights of one round, to the parameter server (fedavg)."""
    return f"{ROOT}/{run}/{arm}/ul/{task}/{agent}/weights"


def cluster_model(run: str, arm: str, task: Level) -> str:
    """One round's model from the data center to all robots of a cluster (fedavg, centralized)."""
    return f"{ROOT}/{run}/{arm}/dl/{task}/model"


def episode(run: str, arm: str, task: Level, agent: Level) -> str:
    """The reward of a robot's episode with the data center's model of a round (centralized)."""
    return f"{ROOT}/{run}/{arm}/ctl/{task}/{agent}/episode"


def model_again(run: str, arm: str, task: Level) -> str:
    """Asks the data center for a cluster's model of a round again."""
    return f"{ROOT}/{run}/{arm}/ctl/{task}/0/again"


def presence(run: str, task: Level, agent: Level) -> str:
    """Retained: where a robot stands (see `payloads.Presence`); its last will too. The data center is 0, 0."""
    return f"{ROOT}/{run}/{SHARED}/ctl/{task}/{agent}/presence"


def resend(run: str, arm: str, task: Level, agent: Level) -> str:
    """Asks robot `agent` to publish its weights of a round again."""
    return f"{ROOT}/{run}/{arm}/ctl/{task}/{agent}/resend"


def collect_again(run: str, arm: str, task: Level, agent: Level) -> str:
    """Asks training robot `agent` for the experience of a round again."""
    return f"{ROOT}/{run}/{arm}/ctl/{task}/{agent}/collect"


def meta_round(run: str, arm: str) -> str:
    """Retained: the MAML rounds whose experience the data center wants; past t0, that the stage is over."""
    return f"{ROOT}/{run}/{arm}/ctl/meta/round"


def meta_resend(run: str, arm: str) -> str:
    """Asks the data center to publish the meta-model again."""
    return f"{ROOT}/{run}/{arm}/ctl/meta/resend"


def telemetry(run: str, arm: str, client: str) -> str:
    """Rows for `rounds.jsonl`, one message a row."""
    return f"{ROOT}/{run}/{arm}/tlm/{client}/round"


def learned(run: str, arm: str, task: Level) -> str:
    """The learned weights of a task, for the run directory."""
    return f"{ROOT}/{run}/{arm}/tlm/{task}/learned"


def snapshot(run: str, arm: str, round_: Level) -> str:
    """The meta-model after some MAML rounds, for the run directory."""
    return f"{ROOT}/{run}/{arm}/tlm/{round_}/snapshot"


def broker_answer(asked: str) -> str:
    """The broker's answer to one question on BROKER_METER_ASK, by the question's token."""
    return f"{BROKER_METER}/{asked}"


def meter_report(run: str, client: str) -> str:
    """A client's final byte counters."""
    return f"{ROOT}/{run}/meter/{client}"


def recorder(run: str) -> str:
    """Retained: a recorder is there, and acknowledges what it has written down; its last will too."""
    return f"{ROOT}/{run}/meter/{RECORDER}/here"


def acknowledgement(run: str, client: str) -> str:
    """What the recorder has written down of a client's. As of reports, nobody's counters hold it."""
    return f"{ROOT}/{run}/meter/{client}/ack"


def probe(run: str) -> str:
    """From the recorder to itself: whether the broker passes on a message of the run's largest size. Not metered."""
    return f"{ROOT}/{run}/meter/{RECORDER}/probe"


def scenario(run: str, whose: str) -> str:
    """Retained: the run's scenario, of the recorder, or of whoever came first (`SHARED`). Never metered."""
    return f"{ROOT}/{run}/meter/{whose}/scenario"


def wait(run: str, client: str) -> str:
    """Asks a client how it is, or tells it how one is that it asked; the recorder hears of all waits. Not metered."""
    return f"{ROOT}/{run}/meter/{client}/wait"


def claim(run: str, task: int, agent: int) -> str:
    """A process claims to be robot `agent` (0: the data center); one that is answers on the same topic."""
    return f"{ROOT}/{run}/{SHARED}/ctl/{task}/{agent}/claim"


def run_of(topic: str) -> str:
    """Run name of a metered topic."""
    return topic.split("/", 3)[1]


def arm_of(topic: str) -> str:
    """Arm of a metered topic."""
    return topic.split("/", 4)[2]


def task_of(topic: str) -> str:
    """The level of an experience, weights or model topic that holds its task's id."""
    return topic.split("/", 5)[4]


def agent_of(topic: str) -> str:
    """The level of an experience or weights topic that holds its robot's id; "" where there is none."""
    levels = topic.split("/", 6)
    return levels[5] if len(levels) > 6 else ""
