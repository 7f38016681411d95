"""Every method over the in-memory bus: it completes, moves what it should, and survives what the bus loses once."""

from __future__ import annotations

import functools
from pathlib import Path

import pytest

import jouleswarm.simulation
from jouleswarm.common.bus.bus import MemoryHub, Message
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.topics import Link
from jouleswarm.methods.shipped import all_shipped
from jouleswarm.runs.traffic import traffic
from jouleswarm.simulation import Outcome, run_in_memory

METHODS = tuple(all_shipped())
META_METHODS = tuple(name for name, method in all_shipped().items() if method.stage is not None)
TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"  # 2 tasks, 2 robots each, one training task
ROUNDS, T0, MOTIONS, BATCHES, ROBOTS = 3, 2, 6, 4, 4
SMALL = [
    f"federation.max_rounds={ROUNDS}", "federation.target_reward=1000", f"meta.t0={T0}",
    f"learning.motions_per_round={MOTIONS}", f"learning.batches_per_round={BATCHES}",
]  # fmt: skip

# (uplink, downlink, sidelink) messages of a run of ROUNDS rounds
META = (T0 * MOTIONS, ROBOTS, ROUNDS * ROBOTS)  # one robot's experience, the meta-model, each to its one neighbour
MESSAGES = {
    "fl": (0, 0, ROUNDS * ROBOTS),
    "isolated": (0, 0, 0),
    "fedavg": (ROUNDS * ROBOTS, ROUNDS * ROBOTS, 0),
    "centralized": (ROUNDS * ROBOTS * MOTIONS, ROUNDS * ROBOTS, 0),
    **dict.fromkeys(META_METHODS, META),
}


def small(method: str, *overrides: str) -> Scenario:
    return load_scenario(TOY, [*SMALL, f"methods=['{method}']", *overrides])


@functools.cache
def alone(method: str) -> Outcome:
    return run_in_memory(small(method))


@pytest.mark.parametrize("method", METHODS)
def test_a_method_moves_its_messages_and_computes_its_gradients(method: str) -> None:
    outcome = alone(method)
    rows = outcome.hub.meter.rows()
    links = (Link.UPLINK, Link.DOWNLINK, Link.SIDELINK)
    assert tuple(traffic(rows, method, link).messages for link in links) == MESSAGES[method]
    robots = sum(row.gradients for row in outcome.rows if row.agent and row.phase == "fl")
    center = sum(row.gradients for row in outcome.rows if not row.agent)
    if method == "centralized":
        assert (robots, center) == (0, ROUNDS * ROBOTS * BATCHES)
    else:
        meta = T0 * (4 + 4) if method in META_METHODS else 0  # the toy scenario's B^(a) and B^(b)
        assert (robots, center) == (ROUNDS * ROBOTS * BATCHES, meta)
    assert set(outcome.learned) == {(method, 1), (method, 2)}
    ends = {(row.task, row.agent): row.round for row in outcome.rows if row.agent and row.learned is False}
    assert ends == {(1, 1): ROUNDS, (1, 2): ROUNDS, (2, 3): ROUNDS, (2, 4): ROUNDS}


def test_arms_of_all_methods_in_one_run_are_what_each_is_alone() -> None:
    together = run_in_memory(load_scenario(TOY, [*SMALL, f"methods={list(METHODS)}", "meta.adapt_from=[1]"]))
    assert len(together.learned) == 2 * (len(METHODS) + len(META_METHODS))
    for method in ("fl", "centralized", "multitask"):
        learned = alone(method).learned
        assert {key: together.learned[key] for key in learned} == learned


class LosingHub(MemoryHub):
    """Loses the first message on each topic that ends in one of `words`."""

    words: tuple[str, ...] = ()

    def route(self, client: str, message: Message, qos: int, retain: bool) -> None:
        lost = self.__dict__.setdefault("_lost", set())
        if message.topic.endswith(self.words) and message.topic not in lost:
            lost.add(message.topic)
            return
        super().route(client, message, qos, retain)


def results(outcome: Outcome) -> tuple[object, ...]:
    # A round of experience that is sent again is reported again.
    rows = {row.model_dump_json(exclude={"seconds"}) for row in outcome.rows}
    return rows, outcome.learned, outcome.snapshots


@pytest.mark.parametrize(
    ("method", "words"),
    [
        ("fl", ("/weights",)),
        ("fedavg", ("/weights", "/model")),
        ("centralized", ("/transition", "/model", "/episode")),
        ("multitask", ("/experience", "/weights")),
    ],
)
def test_what_is_lost_is_asked_for_again_and_the_end_is_the_same_to_the_bit(
    method: str, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LosingHub, "words", words)
    monkeypatch.setattr(jouleswarm.simulation, "MemoryHub", LosingHub)
    assert results(run_in_memory(small(method, "bus.resend_after_s=0.05"))) == results(alone(method))
