"""Whole runs, in memory, of methods that a user has written: a rule, a memory, a stage, a server, a central learner."""

from __future__ import annotations

from pathlib import Path

import pytest
import safetensors.numpy

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.topics import Link
from jouleswarm.runs.sizes import expected_counts, scenario_sizes
from jouleswarm.runs.traffic import traffic
from jouleswarm.simulation import Outcome, run_in_memory
from tests.simulation.test_killed import SMALL, TOY, Death, Deployment

PATIENT = "bus.resend_after_s=60"  # nothing is sent again because of impatience

OWN = '''
import numpy as np
from jouleswarm import Method
from jouleswarm.common.disk.state import State
from jouleswarm.methods.method import Gradients

class Momentum(Method):
    """Consensus whose steps go on for a while: a memory of its own."""
    name = "momentum"

    def __init__(self):
        self.moving = {}

    def mix(self, own, theirs, step):
        mixed = super().mix(own, theirs, step)
        self.moving = {key: (mixed[key] - own[key]) + np.float32(0.5) * self.moving.get(key, 0) for key in own}
        return {key: own[key] + self.moving[key] for key in own}

    def state(self):
        return State(dict(self.moving))

    def load_state(self, state):
        self.moving = dict(state.arrays)

class MomentumServer(Momentum):
    """The same in the data center (Hsu et al. 2019)."""
    name, partners = "momentum-server", "datacenter"
    mix = Method.mix

    def serve(self, round_):
        average, _ = super().serve(round_)
        before = self.held = getattr(self, "held", None) or average
        self.moving = {key: (average[key] - before[key]) + np.float32(0.5) * self.moving.get(key, 0) for key in average}
        self.held = {key: before[key] + self.moving[key] for key in average}
        return self.held, 0

    def state(self):
        return State.of({"moving": State(dict(self.moving)), "held": State(dict(getattr(self, "held", None) or {}))})

    def load_state(self, state):
        self.moving, self.held = dict(state.part("moving").arrays), dict(state.part("held").arrays) or None

class Copies:
    """Trains nothing: a model of which every weight is how many rounds it has seen."""
    tally = None

    def __init__(self, scenario):
        from jouleswarm.learning.networks import build_qnetwork, to_weights
        self.model, self.rounds = to_weights(build_qnetwork(scenario, 1)), 0

    def learn(self, round_, replays):
        self.rounds += 1
        batches = [replay.sample(4, np.random.default_rng(round_)) for replay in replays[1].values()]
        for _ in batches:
            self.tally(1).gradients(1)
        return {1: Gradients(len(batches))}

    def weights(self):
        return {key: np.full_like(value, self.rounds / 100) for key, value in self.model.items()}

    def beta(self):
        return 1.0

    def state(self):
        return State(values={"rounds": self.rounds})

    def load_state(self, state):
        self.rounds = state.values["rounds"]

class Staged(Method):
    """A stage of one's own, without last layers for each task."""
    name, stage = "staged", Copies

    def heads(self, scenario):
        return ()

class Both(Staged):
    """A stage before, and the data center in every round after it."""
    name, partners = "both", "datacenter"

class Central(Method):
    """The data center learns half as many batches as the robots would have."""
    name, partners, sends = "central", "datacenter", "experience"

    def serve(self, round_):
        gradients = round_.learner.learn(round_.batches // 2)
        return round_.learner.weights(), gradients

class Near(Method):
    """Far too near to where each round began: nothing is learned."""
    name = "near"

    def penalty(self, params, start):
        return 1e6 * sum(((params[key] - start[key]) ** 2).sum() for key in params)
'''


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("own")
    (folder / "own.py").write_text(OWN)
    (folder / "toy.toml").write_text(TOY.read_text())
    return folder


def own(folder: Path, *methods: str, more: tuple[str, ...] = ()) -> Scenario:
    return load_scenario(folder / "toy.toml", [*SMALL, f"methods={list(methods)}", *more])


def moved(outcome: Outcome, arm: str) -> tuple[int, ...]:
    rows = outcome.hub.meter.rows()
    return tuple(traffic(rows, arm, link).messages for link in (Link.UPLINK, Link.DOWNLINK, Link.SIDELINK))


@pytest.mark.parametrize(
    ("method", "codec", "death"),
    [
        ("Momentum", "float32", Death("agent-1", "weights", 3)),
        ("Momentum", "topk", Death("agent-1", "weights", 3, sent=True)),
        ("MomentumServer", "int8", Death("datacenter", "model", 4)),
        ("Staged", "float32", Death("datacenter", "round", 2)),
        ("Both", "float32", Death("datacenter", "model", 3)),
        ("Central", "float32", Death("datacenter", "model", 3)),
    ],
)
def test_what_a_method_remembers_comes_back_with_who_is_killed(
    folder: Path, method: str, codec: str, death: Death, tmp_path: Path
) -> None:
    scenario = own(folder, f"own:{method}", more=(f"federation.codec={codec}",))
    undisturbed = run_in_memory(scenario)
    end = Deployment(scenario, tmp_path).run(death)
    assert end.rows == {row.model_dump_json(exclude={"seconds", "refused"}) for row in undisturbed.rows}
    learned = {f"{arm}/tlm/{task}/learned": payload for (arm, task), payload in undisturbed.learned.items()}
    assert learned.items() <= end.models.items()
    assert list(tmp_path.iterdir()) == []  # no state is left


def test_a_memory_makes_a_difference(folder: Path) -> None:
    outcome = run_in_memory(own(folder, "fl", "own:Momentum"))
    assert outcome.learned["fl", 1] != outcome.learned["momentum", 1]


def test_robots_start_from_a_stage_s_model_and_its_gradients_are_billed(folder: Path) -> None:
    still = ("federation.max_rounds=1", "learning.optimizer=sgd", "learning.lr=1e-30", "meta.adapt_from=[1]", PATIENT)
    scenario = own(folder, "own:Staged", more=still)
    outcome = run_in_memory(scenario)
    for arm, rounds in (("staged-t1", 1), ("staged", 2)):
        model = safetensors.numpy.load(outcome.learned[arm, 2])
        (value,) = {float(value) for tensor in model.values() for value in tensor.ravel()}
        assert value == pytest.approx(rounds / 100)
    center = [(row.round, row.gradients_support, row.gradients_query) for row in outcome.rows if row.agent == 0]
    assert center == [(1, 1, 0), (2, 1, 0)]
    assert moved(outcome, "staged") == (2 * 6, 4, 4)  # experience of 2 rounds, the model to 4 robots, weights


def test_a_stage_and_a_server_are_told_apart_by_phase(folder: Path) -> None:
    outcome = run_in_memory(own(folder, "own:Both", more=(PATIENT,)))
    rows = outcome.hub.meter.rows()
    # 2 rounds of 6 motions up and a model to each of 4 robots; then 3 rounds of 4 robots, up and down
    assert moved(outcome, "both") == (2 * 6 + 12, 4 + 12, 0)
    told = {
        (phase, link): traffic(rows, "both", link, phase=phase).messages
        for phase in ("maml", "fl")
        for link in (Link.UPLINK, Link.DOWNLINK)
    }
    assert list(told.values()) == [12, 4, 12, 12]


def test_a_central_learner_of_one_s_own_is_served_and_counted(folder: Path) -> None:
    outcome = run_in_memory(own(folder, "own:Central", more=(PATIENT,)))
    assert moved(outcome, "central") == (3 * 4 * 6, 12, 0)
    assert sum(row.gradients for row in outcome.rows if not row.agent) == 2 * 3 * 4  # tasks, rounds, half of 2 x 4


def test_a_penalty_holds_robots_where_their_rounds_begin(folder: Path) -> None:
    outcome = run_in_memory(own(folder, "fl", "own:Near"))
    free, near = (safetensors.numpy.load(outcome.learned[arm, 1]) for arm in ("fl", "near"))
    start = safetensors.numpy.load(run_in_memory(own(folder, "fl", more=("learning.lr=1e-30",))).learned["fl", 1])

    def far(model: dict[str, object]) -> float:
        return sum(float(abs(tensor - start[name]).sum()) for name, tensor in model.items())

    assert far(near) < far(free) / 2


def test_the_closed_form_has_the_heads_that_a_method_says(folder: Path) -> None:
    scenario = own(folder, "maml", "own:Staged")  # `meta.heads` is per_task; Staged says that it has none
    sizes = scenario_sizes(scenario)
    assert sizes.meta_model_of["staged"] == sizes.weights_bytes < sizes.meta_model_of["maml"]
    counts = expected_counts(scenario, "staged", 2, {1: 3, 2: 3}, sizes)
    assert counts.ml.downlink_bytes == 4 * sizes.weights_bytes  # to each of 4 robots


def test_the_closed_form_of_one_s_own_is_by_whom_it_meets(folder: Path) -> None:
    scenario = own(folder, "own:Momentum", "own:MomentumServer", "own:Central", "own:Staged")
    outcome, sizes = run_in_memory(scenario), scenario_sizes(scenario)
    for arm in ("momentum", "momentum-server", "staged"):
        computed = sum(row.gradients for row in outcome.rows if row.arm == arm and row.agent)
        counts = expected_counts(scenario, arm, 0, {1: 3, 2: 3}, sizes)
        assert counts.fl.gradients_robots == computed == 3 * 4 * 4
        links = [bool(size) for size in (counts.fl.uplink_bytes, counts.fl.downlink_bytes, counts.fl.sidelink_bytes)]
        phase_links = [
            traffic(outcome.hub.meter.rows(), arm, link, phase="fl").messages > 0
            for link in (Link.UPLINK, Link.DOWNLINK, Link.SIDELINK)
        ]
        assert links == phase_links
