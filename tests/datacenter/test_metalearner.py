"""The meta-learner round by round, and its checkpoint."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from common.errors import RunError, TrainingError
from common.methods import META_METHODS, Method
from common.scenario import Scenario
from datacenter.checkpoint import Checkpoint
from datacenter.metalearner import Gradients, MetaLearner

Make = Callable[..., Any]


def one_round(learner: MetaLearner, experience: dict[int, Any], round_: int) -> dict[int, Gradients]:
    for task, robots in experience.items():
        for motions in robots:
            learner.remember(task, motions)
    return learner.learn(round_)


def as_bytes(learner: MetaLearner) -> bytes:
    return b"".join(tensor.tobytes() for tensor in learner.weights().values())


def test_a_round_counts_the_batches_of_every_training_task(make_scenario: Make, make_experience: Make) -> None:
    scenario = make_scenario()
    counted = one_round(MetaLearner(scenario, "maml"), make_experience(scenario, 1), 1)
    assert counted == {1: Gradients(support=2, query=3), 2: Gradients(support=2, query=3)}


def test_the_first_step_is_adams_of_the_meta_learning_rate(make_scenario: Make, make_experience: Make) -> None:
    scenario = make_scenario(meta={"meta_lr": 1e-3})
    learner = MetaLearner(scenario, "maml")
    before = learner.weights()
    one_round(learner, make_experience(scenario, 1), 1)
    steps = np.concatenate([(after - before[name]).ravel() for name, after in learner.weights().items()])
    # Adam's first step is lr x g / (|g| + 1e-8): the learning rate whatever the gradient, never more
    assert np.abs(steps).max() == pytest.approx(1e-3, rel=1e-3)


def test_the_meta_model_starts_from_the_seed(make_scenario: Make) -> None:
    assert as_bytes(MetaLearner(make_scenario(), "maml")) == as_bytes(MetaLearner(make_scenario(), "maml"))
    assert as_bytes(MetaLearner(make_scenario(seed=6), "maml")) != as_bytes(MetaLearner(make_scenario(), "maml"))


@pytest.mark.parametrize("method", META_METHODS)
def test_the_same_experience_trains_the_same_to_the_bit(
    method: Method, make_scenario: Make, make_experience: Make
) -> None:
    scenario = make_scenario()
    learners = [MetaLearner(scenario, method), MetaLearner(scenario, method)]
    for index, learner in enumerate(learners):
        torch.manual_seed(index)  # must not matter
        for round_ in (1, 2):
            one_round(learner, make_experience(scenario, round_), round_)
    assert as_bytes(learners[0]) == as_bytes(learners[1])


def test_a_tasks_target_goes_its_share_of_the_way_to_the_adapted_model(
    make_scenario: Make, make_experience: Make
) -> None:
    targets = {}
    for rate in (0.25, 1.0):
        scenario = make_scenario(meta={"target_polyak": rate})
        learner = MetaLearner(scenario, "maml")
        start = {name: value.clone() for name, value in learner.state().items()}
        one_round(learner, make_experience(scenario, 1), 1)
        targets[rate] = learner.state()
    names = [name for name in start if name.startswith("target/")]
    assert len(names) == 2 * 6  # two tasks; weight and bias of three layers
    for name in names:  # a rate of 1 is the adapted model itself
        expected = start[name] + 0.25 * (targets[1.0][name] - start[name])
        torch.testing.assert_close(targets[0.25][name], expected)
        assert not torch.equal(targets[1.0][name], start[name])


@pytest.mark.parametrize(("newest", "depends"), [(4, False), (8, True)])
def test_the_adaptation_is_rehearsed_on_the_newest_motions_only(
    newest: int, depends: bool, make_scenario: Make, make_experience: Make
) -> None:
    scenario = make_scenario(meta={"support_newest": newest, "target_polyak": 1.0})
    targets = []
    for first_round in (1, 3):  # other motions before the same 4 newest ones
        learner = MetaLearner(scenario, "maml")
        for task, robots in make_experience(scenario, first_round).items():
            learner.remember(task, robots[0])
        one_round(learner, make_experience(scenario, 2), 2)
        targets.append(learner.state()["target/1/0.weight"].clone())  # the adapted model itself
    assert torch.equal(*targets) is not depends


def test_a_gradient_that_is_not_finite_ends_training_and_says_so(make_scenario: Make, make_experience: Make) -> None:
    scenario = make_scenario(meta={"inner_lr": 1e38})  # the adapted parameters overflow
    with pytest.raises(TrainingError, match=r"meta-gradient of round 1 is not finite; lower meta\.inner_lr"):
        one_round(MetaLearner(scenario, "maml"), make_experience(scenario, 1), 1)


def trained(
    scenario: Scenario, make_experience: Make, folder: Path | None, rounds: int, method: Method = "maml"
) -> MetaLearner:
    learner, checkpoint = MetaLearner(scenario, method), Checkpoint(folder)
    for round_ in range(1, rounds + 1):
        experience = make_experience(scenario, round_)
        one_round(learner, experience, round_)
        checkpoint.save(round_, learner, experience)
    return learner


@pytest.mark.parametrize("method", META_METHODS)
def test_a_restored_learner_goes_on_bit_by_bit_as_if_never_stopped(
    method: Method, make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    scenario = make_scenario()
    undisturbed = trained(scenario, make_experience, tmp_path, 2, method)
    restored = MetaLearner(scenario, method)
    assert Checkpoint(tmp_path).restore(restored) == 2
    for round_ in (3, 4):
        for learner in (undisturbed, restored):
            one_round(learner, make_experience(scenario, round_), round_)
        assert as_bytes(restored) == as_bytes(undisturbed)
    ours, theirs = restored.state(), undisturbed.state()
    assert ours.keys() == theirs.keys()
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)


def test_a_full_replay_memory_is_restored_as_it_was(make_scenario: Make, make_experience: Make, tmp_path: Path) -> None:
    scenario = make_scenario(meta={"replay_size": 6})  # the second round of 4 motions runs over its end
    undisturbed = trained(scenario, make_experience, tmp_path, 3)
    restored = MetaLearner(scenario, "maml")
    Checkpoint(tmp_path).restore(restored)
    for learner in (undisturbed, restored):
        one_round(learner, make_experience(scenario, 4), 4)
    assert as_bytes(restored) == as_bytes(undisturbed)


def test_without_a_checkpoint_training_begins_at_the_beginning(make_scenario: Make, tmp_path: Path) -> None:
    learner = MetaLearner(make_scenario(), "maml")
    assert Checkpoint(tmp_path / "new").restore(learner) == 0
    assert Checkpoint(None).restore(learner) == 0
    assert as_bytes(learner) == as_bytes(MetaLearner(make_scenario(), "maml"))


def test_without_a_folder_nothing_is_written(make_scenario: Make, make_experience: Make, tmp_path: Path) -> None:
    trained(make_scenario(), make_experience, None, 1)
    assert list(tmp_path.iterdir()) == []


def test_a_cleared_checkpoint_is_forgotten(make_scenario: Make, make_experience: Make, tmp_path: Path) -> None:
    trained(make_scenario(), make_experience, tmp_path, 2)
    checkpoint = Checkpoint(tmp_path)
    checkpoint.finish()
    assert checkpoint.is_finished
    checkpoint.clear()
    assert not tmp_path.exists()
    assert Checkpoint(tmp_path).restore(MetaLearner(make_scenario(), "maml")) == 0


OTHERS: dict[str, dict[str, Any]] = {
    "another network": {"network": {"dense": [9]}},
    "another input": {"network": {"width": 9}},
    "more training tasks": {"meta": {"training_tasks": [1, 2, 3]}},
    "fewer training tasks": {"meta": {"training_tasks": [1]}},
    "another seed": {"seed": 6},
    "another map": {"tasks": [{"id": task, "map": ". E . \n . * . \n . * . \n . * X"} for task in (1, 2, 3)]},
    "fewer rounds than it holds": {"meta": {"t0": 3}},
}


@pytest.mark.parametrize("other", OTHERS)
def test_another_scenarios_checkpoint_is_refused(
    other: str, make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    trained(make_scenario(), make_experience, tmp_path, 1)
    with pytest.raises(RunError, match=r"does not fit this scenario .* name another folder with --state"):
        Checkpoint(tmp_path).restore(MetaLearner(make_scenario(**OTHERS[other]), "maml"))


@pytest.mark.parametrize("damage", ["state cut off", "state empty", "experience missing", "experience cut off"])
def test_a_damaged_checkpoint_is_refused(
    damage: str, make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    trained(make_scenario(), make_experience, tmp_path, 2)
    state, experience = tmp_path / "state.safetensors", tmp_path / "round-00001.safetensors"
    if damage == "state cut off":
        state.write_bytes(state.read_bytes()[:-100])
    elif damage == "state empty":
        state.write_bytes(b"")
    elif damage == "experience missing":
        experience.unlink()
    else:
        experience.write_bytes(experience.read_bytes()[:-100])
    with pytest.raises(RunError, match=f"checkpoint {tmp_path}"):
        Checkpoint(tmp_path).restore(MetaLearner(make_scenario(), "maml"))


def test_a_round_cut_off_while_it_was_saved_is_simply_not_there(
    make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    trained(make_scenario(), make_experience, tmp_path, 1)
    # killed after round 2's experience was written and in the middle of its state
    (tmp_path / "round-00002.safetensors").write_bytes((tmp_path / "round-00001.safetensors").read_bytes())
    (tmp_path / "state.part").write_bytes(b"half a st")
    assert Checkpoint(tmp_path).restore(MetaLearner(make_scenario(), "maml")) == 1
