"""Plans of studies: which deployments, with which settings."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.environments.landmarks.families import similarity
from jouleswarm.environments.landmarks.settings import task_map
from jouleswarm.studies.catalogue import kind_of
from jouleswarm.studies.jobs import Job, Request, range_of_seeds

ROOT = Path(__file__).parents[2]
QUICK, TOY = ROOT / "scenarios" / "quick.toml", ROOT / "scenarios" / "toy.toml"


def request(file: Path = QUICK, *overrides: str, seeds: int = 2, t0: int = 42) -> Request:
    return Request(file, overrides, range_of_seeds(seeds, 1), t0)


def scenarios(name: str, asked: Request) -> dict[tuple[str, int], Scenario]:
    return {(job.variant, job.seed): job.load() for job in kind_of(name).plan(asked).jobs}


def test_the_paper_study_is_one_deployment_a_seed_and_method_adapted_from_every_t0() -> None:
    jobs = kind_of("paper").plan(request(seeds=2)).jobs
    assert [job.seed for job in jobs] == [1] * 4 + [2] * 4
    assert {job.variant for job in jobs} == {""}
    assert len({job.name for job in jobs}) == 8
    maml, fomaml, own, plain = (job.load() for job in jobs[:4])
    assert [one.method_names for one in (fomaml, own, plain)] == [("fomaml",), ("multitask",), ("fl",)]
    assert maml.arm_names == (*(f"maml-t{t0}" for t0 in (42, 66, 90, 132, 210)), "maml")
    assert [arm.t0 for arm in maml.arms] == [42, 66, 90, 132, 210, 240]
    assert maml.energy.beta == "measured"


@pytest.mark.parametrize(
    ("asked", "methods"),
    [
        (Request(QUICK, (), (1,), 0, ("maml", "reptile")), ["maml", "reptile", "fl"]),
        (request(QUICK, 'methods=["fl","anil"]', seeds=1, t0=0), ["fl", "anil"]),
        (request(TOY, seeds=1, t0=0), ["maml", "fomaml", "multitask", "fl"]),
    ],
)
def test_methods_of_the_paper_study_are_those_asked_for(asked: Request, methods: list[str]) -> None:
    assert [job.load().methods for job in kind_of("paper").plan(asked).jobs] == [(method,) for method in methods]


def test_what_the_user_sets_comes_after_what_the_study_sets() -> None:
    asked = Request(TOY, ("meta.t0=4", "meta.adapt_from=[2]"), (1,), 0, ("maml",))
    assert [job.load().arm_names for job in kind_of("paper").plan(asked).jobs] == [("maml-t2", "maml"), ("fl",)]


def test_further_seeds_of_the_paper_study_are_at_one_t0_and_without_transfer() -> None:
    settings = ("meta.t0=4", "meta.adapt_from=[2]")
    asked = Request(TOY, settings, (1,), 2, ("maml",), more_seeds=(2, 3))
    found = [(job.seed, [arm[:3:2] for arm in job.load().arms]) for job in kind_of("paper").plan(asked).jobs]
    first = [(1, [("maml-t2", 2), ("maml", 4)]), (1, [("fl", 0)])]
    assert found == [*first, *((seed, [arm]) for seed in (2, 3) for arm in (("maml", 2), ("fl", 0)))]
    with pytest.raises(ConfigurationError, match="--more-seeds without --t0"):
        kind_of("paper").plan(Request(TOY, settings, (1,), 0, ("maml",), more_seeds=(2,)))


def test_the_scenarios_own_meta_method_is_the_one_that_is_studied(tmp_path: Path) -> None:
    file = tmp_path / "r.toml"
    file.write_text(QUICK.read_text().replace('["multitask", "fl"]', '["fl", "reptile"]'))
    one = scenarios("regimes", request(file, seeds=1, t0=7))["base", 1]
    assert one.methods == ("reptile", "fl")
    assert one.meta.t0 == 7


@pytest.mark.parametrize(
    ("overrides", "t0", "message"),
    [
        ((), 43, "got --t0 43, expected one of the scenario's: 42, 66, 90, 132, 210, 240"),
        (('methods=["fl"]',), 0, "got methods fl, expected one with meta-learning, and fl"),
        (('methods=["maml"]',), 0, "got methods maml, expected"),
    ],
)
def test_a_paper_study_that_could_make_no_figures_is_refused(overrides: tuple[str, ...], t0: int, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        kind_of("paper").plan(request(QUICK, *overrides, t0=t0))


def test_baselines_are_all_nine_methods_and_one_robot_a_task() -> None:
    jobs = kind_of("baselines").plan(request(seeds=1)).jobs
    loaded = [(job.variant, job.load()) for job in jobs]
    assert len({one.methods for variant, one in loaded if not variant}) == 9
    alone = {one.methods: one.federation.robots_per_cluster for variant, one in loaded if variant == "robots=1"}
    assert alone == {("fl",): 1, ("multitask",): 1}
    assert {(one.meta.t0, one.energy.beta) for _, one in loaded} == {(42, "measured")}


def test_points_of_a_sweep_that_come_to_the_same_scenario_are_run_once() -> None:
    plan = kind_of("sensitivity").plan(request(seeds=1))
    # Q = 3, 2 robots and 20 batches are the scenario as it is; 8 robots are fully meshed anyway.
    assert [job.variant for job in plan.jobs] == [
        "Q=1", "Q=2", "base", "Q=6", "robots=1", "robots=4", "robots=8", "topology=ring", "topology=random",
        "batches=5", "batches=10", "batches=40",
    ]  # fmt: skip
    assert plan.groups["topology"] == {"full": "robots=8", "ring": "topology=ring", "random": "topology=random"}
    assert plan.groups["batches"]["20"] == "base"
    assert plan.training == {"Q=1": (1,), "Q=2": (1, 2), "Q=6": (1, 2, 3, 4, 5, 6)}


def test_sensitivity_varies_one_setting_at_a_time() -> None:
    found = scenarios("sensitivity", request(seeds=1))
    assert found["Q=2", 1].meta.training_tasks == (1, 2)
    assert found["Q=6", 1].meta.training_tasks == (1, 2, 3, 4, 5, 6)
    assert len(found["robots=8", 1].agents) == 48
    assert found["topology=random", 1].federation.degree == 3
    assert found["batches=40", 1].learning.batches_per_round == 40
    assert found["batches=40", 1].federation == found["base", 1].federation


def test_the_authors_regime_is_a_slow_learner_with_a_target_copied_rarely() -> None:
    learning = scenarios("regimes", request(seeds=1))["regime=authors", 1].learning
    assert (learning.lr, learning.target_polyak, learning.target_every) == (2.5e-4, 1, 100)


def test_the_authors_regime_in_earnest_is_for_both_arms() -> None:
    one = scenarios("regimes", request(seeds=1))["regime=earnest", 1]
    learning, meta = one.learning, one.meta
    assert (learning.lr, learning.target_polyak, learning.target_every) == (2.5e-4, 1, 2000)
    assert (learning.epsilon, learning.starts, meta.epsilon, meta.starts) == (0.1, "entry", 0.1, "entry")
    assert one.federation.max_rounds == 1000


def test_similarity_draws_a_family_of_tasks_a_stem_and_seed() -> None:
    plan = kind_of("similarity").plan(request(seeds=2))
    assert len(plan.jobs) == 7 * 2
    for job in plan.jobs:
        loaded = job.load()
        stem = int(job.variant.removeprefix("stem="))
        paths = [task_map(loaded, task.id).path for task in loaded.tasks]
        assert len({path[: stem + 1] for path in paths}) == 1
        assert plan.values[job.variant][job.seed] == pytest.approx(similarity(paths), abs=1e-6)


def test_a_job_writes_the_scenario_that_its_processes_load(tmp_path: Path) -> None:
    job = Job("", 5, QUICK.read_text(), ("meta.t0=3",))
    path = job.write(tmp_path / "deep" / "job")
    assert path.read_text() == QUICK.read_text()
    assert job.settings == ("meta.t0=3", "seed=5")
    assert json.loads(job.load().model_dump_json())["seed"] == 5


@pytest.mark.parametrize(("count", "first"), [(0, 1), (3, -1)])
def test_seeds_that_cannot_be_are_refused(count: int, first: int) -> None:
    with pytest.raises(ConfigurationError, match=f"got {count} seeds from {first} on"):
        range_of_seeds(count, first)


def test_a_scenario_that_is_not_there_is_told() -> None:
    with pytest.raises(ConfigurationError, match="name one with --scenario"):
        kind_of("paper").plan(request(Path("nowhere.toml")))
