"""The meta-learner round by round, and its checkpoint."""

import math
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from jouleswarm.common.disk.checkpoint import owner_of
from jouleswarm.common.disk.state import Together
from jouleswarm.common.errors import RunError, TrainingError
from jouleswarm.common.meter.meter import Meter
from jouleswarm.common.meter.work import TallyOf, nobody
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.types import Array
from jouleswarm.datacenter.checkpoint import Checkpoint, forget
from jouleswarm.datacenter.experience import Motion, TrainingExperience
from jouleswarm.methods.meta_stage import MetaStage
from jouleswarm.methods.method import Gradients
from jouleswarm.methods.shipped import all_shipped

Make = Callable[..., Any]
META_METHODS = tuple(name for name, method in all_shipped().items() if method.stage is not None)


class MetaLearner:
    """A stage and what its robots have sent, as the data center has them."""

    def __init__(self, scenario: Scenario, method: str, folder: Path | None = None, tally: TallyOf = nobody) -> None:
        self.stage: MetaStage = scenario.method(method).stage(scenario)
        self.stage.tally = tally
        self.experience = TrainingExperience(scenario, folder)
        training = Together({"stage": self.stage, "experience": Together(self.experience.kept)})
        self.state, self.load_state, self.weights = training.state, training.load_state, self.stage.weights

    def remember(self, task: int, motions: list[Motion]) -> None:
        self.experience.remember(motions)

    def learn(self, round_: int) -> dict[int, Gradients]:
        return self.stage.learn(round_, self.experience.replays)


def one_round(learner: MetaLearner, experience: dict[int, Any], round_: int) -> dict[int, Gradients]:
    for task, robots in experience.items():
        for motions in robots:
            learner.remember(task, motions)
    return learner.learn(round_)


def as_bytes(learner: MetaLearner) -> bytes:
    return b"".join(tensor.tobytes() for tensor in learner.weights().values())


def tensors(learner: MetaLearner) -> dict[str, Array]:
    """A copy of everything but the replay memories."""
    return {name: array.copy() for name, array in learner.state().part("stage").arrays.items()}


def test_a_round_counts_the_batches_of_every_training_task(make_scenario: Make, make_experience: Make) -> None:
    scenario = make_scenario()
    counted = one_round(MetaLearner(scenario, "maml"), make_experience(scenario, 1), 1)
    assert counted == {1: Gradients(support=2, query=3), 2: Gradients(support=2, query=3)}


@pytest.mark.parametrize(("method", "done"), [("maml", (2, 3)), ("reptile", (5, 0)), ("multitask", (5, 0))])
def test_each_gradient_is_booked_as_its_round_counts_it(
    method: str, done: tuple[int, int], make_scenario: Make, make_experience: Make
) -> None:
    meter = Meter("client")
    scenario = make_scenario(methods=[method])
    one_round(
        MetaLearner(scenario, method, None, partial(meter.tally, "maml", method)), make_experience(scenario, 1), 1
    )
    told = [(row.task, row.gradients, row.gradients_query) for row in meter.work("datacenter")]
    assert told == [(1, *done), (2, *done)]


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
    method: str, make_scenario: Make, make_experience: Make
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
        start = tensors(learner)
        one_round(learner, make_experience(scenario, 1), 1)
        targets[rate] = tensors(learner)
    names = [name for name in start if name.startswith("target/")]
    assert len(names) == 2 * 6  # two tasks; weight and bias of three layers
    for name in names:  # a rate of 1 is the adapted model itself
        expected = start[name] + 0.25 * (targets[1.0][name] - start[name])
        np.testing.assert_allclose(targets[0.25][name], expected, rtol=1.3e-6, atol=1e-5)
        assert not np.array_equal(targets[1.0][name], start[name])


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
        targets.append(tensors(learner)["target/1/0.weight"])  # the adapted model itself
    assert np.array_equal(*targets) is not depends


def test_a_gradient_that_is_not_finite_ends_training_and_says_so(make_scenario: Make, make_experience: Make) -> None:
    scenario = make_scenario()  # no scenario file may say so: the adapted parameters overflow
    scenario = scenario.model_copy(update={"meta": scenario.meta.model_copy(update={"inner_lr": 1e38})})
    with pytest.raises(TrainingError, match=r"meta-gradient of round 1 is not finite; lower meta\.inner_lr"):
        one_round(MetaLearner(scenario, "maml"), make_experience(scenario, 1), 1)


@pytest.mark.parametrize("method", ["maml", "fomaml"])
def test_learned_step_sizes_go_adams_step_and_stay_in_the_data_center(
    method: str, make_scenario: Make, make_experience: Make
) -> None:
    scenario = make_scenario(methods=[method], meta={"inner_lr": 0.02, "inner_lr_step": 0.05})
    learner = MetaLearner(scenario, method)
    one_round(learner, make_experience(scenario, 1), 1)
    found = tensors(learner)
    for layer in "035":  # Adam's first step is its step size, either way: mu is 0.02 e^0.05 or 0.02 e^-0.05
        assert abs(found[f"model/log_mu/{layer}"] - math.log(0.02)) == pytest.approx(0.05, rel=1e-3)
    assert learner.weights().keys() == MetaLearner(make_scenario(), method).weights().keys()


@pytest.mark.parametrize("method", ["reptile", "multitask"])
def test_who_has_no_step_size_to_learn_learns_none(method: str, make_scenario: Make, make_experience: Make) -> None:
    scenario = make_scenario(methods=[method], meta={"inner_lr_step": 0.05})
    learner, plain = MetaLearner(scenario, method), MetaLearner(make_scenario(methods=[method]), method)
    for each in (learner, plain):
        one_round(each, make_experience(scenario, 1), 1)
    assert as_bytes(learner) == as_bytes(plain)
    assert tensors(learner).keys() == tensors(plain).keys()


def test_every_second_update_takes_tasks_as_unseen(make_scenario: Make, make_experience: Make) -> None:
    scenario = make_scenario(meta={"rehearse_unseen": True})  # an update a round
    learner, plain = MetaLearner(scenario, "maml"), MetaLearner(make_scenario(), "maml")
    for each in (learner, plain):
        one_round(each, make_experience(scenario, 1), 1)
    assert as_bytes(learner) == as_bytes(plain)
    before = tensors(learner)
    for each in (learner, plain):
        one_round(each, make_experience(scenario, 2), 2)
    after = tensors(learner)
    assert as_bytes(learner) != as_bytes(plain)
    for name in before:  # the model learns; targets are of the task's own head, which nothing was rehearsed with
        assert np.array_equal(before[name], after[name]) is name.startswith("target/"), name


def checkpoint_of(scenario: Scenario, folder: Path | None, method: str = "maml") -> Checkpoint:
    return Checkpoint(folder, owner_of(scenario, "r", method), ("maml", method))


def trained(
    scenario: Scenario, make_experience: Make, folder: Path | None, rounds: int, method: str = "maml"
) -> MetaLearner:
    learner, checkpoint = MetaLearner(scenario, method, folder), checkpoint_of(scenario, folder, method)
    for round_ in range(1, rounds + 1):
        one_round(learner, make_experience(scenario, round_), round_)
        checkpoint.save(round_, learner.state())
    return learner


def restored(scenario: Scenario, folder: Path, rounds: int, method: str = "maml") -> MetaLearner:
    """Of a copy of the folder, so that a learner that goes on does not write into its frames."""
    copy = folder.with_name(f"{folder.name}-copy")
    shutil.copytree(folder, copy)
    learner = MetaLearner(scenario, method, copy)
    assert checkpoint_of(scenario, copy, method).restore(learner) == rounds
    return learner


@pytest.mark.parametrize(
    ("method", "meta"),
    [
        *((method, {}) for method in META_METHODS),
        *((method, {"inner_lr_step": 0.01, "rehearse_unseen": True}) for method in ("maml", "fomaml")),
    ],
)
def test_a_restored_learner_goes_on_bit_by_bit_as_if_never_stopped(
    method: str, meta: dict[str, object], make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    scenario = make_scenario(meta=meta)
    undisturbed = trained(scenario, make_experience, tmp_path / "a", 2, method)
    learners = undisturbed, restored(scenario, tmp_path / "a", 2, method)
    for round_ in (3, 4):
        for learner in learners:
            one_round(learner, make_experience(scenario, round_), round_)
        assert as_bytes(learners[1]) == as_bytes(undisturbed)
    ours, theirs = (learner.state() for learner in learners)
    assert ours.values == theirs.values
    assert ours.arrays.keys() == theirs.arrays.keys()
    assert all(np.array_equal(ours.arrays[name], theirs.arrays[name]) for name in ours.arrays)


def test_a_full_replay_memory_is_restored_as_it_was(make_scenario: Make, make_experience: Make, tmp_path: Path) -> None:
    scenario = make_scenario(meta={"replay_size": 6})  # the second round of 4 motions runs over its end
    undisturbed = trained(scenario, make_experience, tmp_path / "a", 3)
    learners = undisturbed, restored(scenario, tmp_path / "a", 3)
    for learner in learners:
        one_round(learner, make_experience(scenario, 4), 4)
    assert as_bytes(learners[1]) == as_bytes(undisturbed)


def test_a_round_that_was_begun_and_is_done_again_comes_to_the_same_end(
    make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    scenario = make_scenario(meta={"replay_size": 6})
    killed = trained(scenario, make_experience, tmp_path / "a", 2)
    for motions in make_experience(scenario, 3)[1]:  # its frames are in the file, over older ones of the state's
        killed.remember(1, motions)
    again = restored(scenario, tmp_path / "a", 2)
    one_round(again, make_experience(scenario, 3), 3)
    assert as_bytes(again) == as_bytes(trained(scenario, make_experience, tmp_path / "b", 3))


def test_without_a_checkpoint_training_begins_at_the_beginning(make_scenario: Make, tmp_path: Path) -> None:
    learner = MetaLearner(make_scenario(), "maml")
    assert checkpoint_of(make_scenario(), tmp_path / "new").restore(learner) == 0
    assert Checkpoint(None).restore(learner) == 0
    assert as_bytes(learner) == as_bytes(MetaLearner(make_scenario(), "maml"))


def test_without_a_folder_nothing_is_written(make_scenario: Make, make_experience: Make, tmp_path: Path) -> None:
    trained(make_scenario(), make_experience, None, 1)
    assert list(tmp_path.iterdir()) == []


def test_a_stage_that_is_finished_leaves_only_the_word_that_it_is(
    make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    trained(make_scenario(), make_experience, tmp_path, 2)
    checkpoint = checkpoint_of(make_scenario(), tmp_path)
    checkpoint.keep_model(1, b"model")
    assert checkpoint.models() == {1: b"model"}
    assert not checkpoint.is_finished
    checkpoint.finish()
    assert checkpoint.is_finished
    assert [path.name for path in tmp_path.iterdir()] == ["finished"]
    forget(None, [checkpoint])
    assert not tmp_path.exists()


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
    scenario = make_scenario(**OTHERS[other])
    with pytest.raises(RunError, match=r"does not fit this scenario .* name another folder with --state"):
        checkpoint_of(scenario, tmp_path).restore(MetaLearner(scenario, "maml"))


def test_another_runs_or_methods_checkpoint_is_refused(
    make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    scenario = make_scenario()
    trained(scenario, make_experience, tmp_path, 1)
    for owner in (owner_of(scenario, "another", "maml"), owner_of(scenario, "r", "fomaml")):
        with pytest.raises(RunError, match=r"does not fit this scenario"):
            Checkpoint(tmp_path, owner).restore(MetaLearner(scenario, "maml"))


@pytest.mark.parametrize("damage", ["state cut off", "state empty", "frames missing"])
def test_a_damaged_checkpoint_is_refused(
    damage: str, make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    scenario = make_scenario()
    trained(scenario, make_experience, tmp_path, 2)
    frames = tmp_path / "frames-1.bin"
    if damage == "frames missing":
        frames.unlink()
    else:
        for state in (tmp_path / "state.0", tmp_path / "state.1"):
            state.write_bytes(state.read_bytes()[:-100] if damage == "state cut off" else b"")
    with pytest.raises(RunError, match=str(frames if damage == "frames missing" else tmp_path)):
        checkpoint_of(scenario, tmp_path).restore(MetaLearner(scenario, "maml", tmp_path))


def test_a_round_cut_off_while_it_was_saved_is_simply_not_there(
    make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    trained(make_scenario(), make_experience, tmp_path, 1)
    assert (tmp_path / "state.1").stat().st_size < 100  # round 2 is begun, and not written
    checkpoint = checkpoint_of(make_scenario(), tmp_path)
    assert checkpoint.restore(MetaLearner(make_scenario(), "maml", tmp_path)) == 1


@pytest.mark.parametrize("damage", ["altered", "gone"])
def test_a_model_kept_to_go_down_is_found_as_it_was_or_refused(
    damage: str, make_scenario: Make, make_experience: Make, tmp_path: Path
) -> None:
    learner, checkpoint = (
        trained(make_scenario(), make_experience, tmp_path, 1),
        checkpoint_of(make_scenario(), tmp_path),
    )
    checkpoint.keep_model(1, b"model")
    checkpoint.save(2, learner.state())
    again = checkpoint_of(make_scenario(), tmp_path)
    again.restore(MetaLearner(make_scenario(), "maml", tmp_path))
    assert again.models() == {1: b"model"}
    model = tmp_path / "model-00001.safetensors"
    if damage == "gone":
        model.unlink()
    else:
        model.write_bytes(b"modeL")
    with pytest.raises(RunError, match=rf"{model}: not as it was written"):
        checkpoint_of(make_scenario(), tmp_path).load()


def test_a_state_that_has_gone_is_missed_where_rows_tell_of_it(make_scenario: Make, tmp_path: Path) -> None:
    checkpoint = checkpoint_of(make_scenario(), tmp_path / "maml")
    row = RoundRow(phase="maml", arm="maml", task=1, agent=0, round=1, seconds=1)
    (tmp_path / "rounds.jsonl").write_text(row.model_dump_json() + "\n")
    assert checkpoint.load() is None  # killed before the first round was saved
    (tmp_path / "rounds.jsonl").write_text(row.model_copy(update={"round": 2}).model_dump_json() + "\n")
    with pytest.raises(RunError, match="the state is gone, though rows of it are there"):
        checkpoint.load()


def test_another_scenarios_mark_of_a_finished_stage_is_refused(make_scenario: Make, tmp_path: Path) -> None:
    checkpoint_of(make_scenario(), tmp_path).finish()
    assert checkpoint_of(make_scenario(), tmp_path).is_finished
    with pytest.raises(RunError, match="finished: not as it was written, or another scenario's"):
        assert checkpoint_of(make_scenario(seed=6), tmp_path).is_finished
