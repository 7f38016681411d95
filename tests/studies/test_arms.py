"""What a study's arms come to, worked out by hand."""

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.studies.arms import PathError, path_error, told_apart
from tests.studies.made_up import meta_fact, task_fact

MAML, PLAIN = Arm("maml", "maml", 42), Arm("fl", "fl", 0)


def test_path_errors_are_those_of_an_arms_tasks_over_all_seeds() -> None:
    facts = [
        meta_fact(MAML),
        task_fact(MAML, 1, 10, seed=1, rmse_m=0.25),
        task_fact(MAML, 2, 10, seed=1, rmse_m=0.5),
        task_fact(MAML, 1, 10, seed=2, rmse_m=0.0),
        task_fact(MAML, 2, 200, seed=2, rmse_m=1.25, learned=False),
        task_fact(PLAIN, 1, 10, rmse_m=4.0),
        task_fact(MAML, 1, 10, variant="other", rmse_m=5.0),
    ]
    assert path_error(facts, "", "maml") == PathError(mean_m=0.5, worst_m=1.25)  # (0.25 + 0.5 + 0 + 1.25) / 4
    assert path_error(facts, "", "maml", [1]) == PathError(mean_m=0.125, worst_m=0.25)
    assert path_error(facts, "", "maml", []) is None


def test_an_environment_without_a_path_has_no_path_error() -> None:
    assert path_error([task_fact(PLAIN, 1, 10, rmse_m=None)], "", "fl") is None


def test_an_arm_that_went_further_in_some_seeds_is_told_by_its_t0() -> None:
    last, on_the_way, plain = Arm("maml", "maml", 240), Arm("maml-t90", "maml", 90), Arm("fl", "fl", 0)
    first = [task_fact(arm, 3, 7, seed=1) for arm in (last, on_the_way, plain)]
    assert told_apart(first) == first
    second = [task_fact(arm, 3, 9, seed=2) for arm in (Arm("maml", "maml", 90), plain)]
    found = [(fact.seed, fact.arm, fact.t0) for fact in told_apart([*first, *second])]
    assert found == [(1, "maml-t240", 240), (1, "maml-t90", 90), (1, "fl", 0), (2, "maml-t90", 90), (2, "fl", 0)]
