"""The meta-learner's state: meta-model, its optimizer, and each training task's replay and target network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch

from jouleswarm.common.disk.state import State
from jouleswarm.common.errors import TrainingError
from jouleswarm.common.meter.work import TallyOf, nobody
from jouleswarm.common.scenario.arms import Method
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.seeding import integer, stream
from jouleswarm.datacenter.experience import Motion, Walks
from jouleswarm.learning.device import compute_device
from jouleswarm.learning.heads import head_of
from jouleswarm.learning.meta import (
    Loss,
    Params,
    TensorBatch,
    make_loss,
    meta_gradient,
    plain_gradient,
    reptile_gradient,
    to_tensors,
)
from jouleswarm.learning.metamodel import MetaModel
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.learning.replay import Replay


@dataclass(frozen=True)
class Gradients:
    """Batch gradients computed for one task in one round."""

    support: int
    query: int


class Batches(NamedTuple):
    """What one meta-update uses of a task's round."""

    support: list[TensorBatch]
    query: list[TensorBatch]


class MetaLearner:
    """One meta method, round by round, on a CUDA device where there is one."""

    def __init__(self, scenario: Scenario, method: Method, folder: Path | None = None, tally: TallyOf = nobody) -> None:
        """`folder`: for the frames of the replay memories, for who wants to go on from a state.

        `tally`: counts batch gradients as they are computed, also of a round that is not kept.
        """
        self._tally = tally
        self._scenario, self._settings, self._method = scenario, scenario.meta, method
        self._device = compute_device()
        self._model = build_qnetwork(scenario, integer(scenario.seed, "initial meta-model")).to(self._device)
        self._head = head_of(self._model)
        tasks = self._settings.training_tasks
        self.meta_model = MetaModel(self._model, tasks if self._settings.heads == "per_task" else ())
        self._leaves = dict(self.meta_model.named())
        self._optimizer = torch.optim.Adam(self._leaves.values(), lr=self._settings.meta_lr, fused=True)
        self._targets: dict[int, Params] = {
            task: {name: value.clone() for name, value in self.meta_model.params(task).items()} for task in tasks
        }
        self._replays = {task: self._replay(task, folder) for task in tasks}
        per_round = scenario.learning.motions_per_round
        self._walks = {task: Walks(replay, per_round) for task, replay in self._replays.items()}

    def remember(self, task: int, motions: list[Motion]) -> None:
        """Put one robot's motions of one round into the task's replay."""
        self._walks[task].remember(motions)

    def learn(self, round_: int) -> dict[int, Gradients]:
        """One round over all training tasks; returns the gradients computed for each.

        B^(a) support and B^(b) query batches a task make B^(a) / inner_steps meta-updates (joint training: one for
        each batch). Random draws depend on seed, round and task only, so that a round resumed is the round
        undisturbed.

        Raises:
            TrainingError: a meta-gradient is not finite.
        """
        updates = {task: self._split(self._draw(task, round_)) for task in self._settings.training_tasks}
        for update in zip(*updates.values(), strict=True):
            self.meta_model.zero_gradients()
            for task, batches in zip(updates, update, strict=True):
                gradient, adapted = self._gradient(task, batches)
                done = self._counts(len(batches.support), len(batches.query))
                self._tally(task).gradients(done.support, done.query)
                self.meta_model.add_gradient(task, gradient, 1 / len(updates))
                torch._foreach_lerp_(
                    list(self._targets[task].values()), list(adapted.values()), self._settings.target_polyak
                )
            self._update(round_)
        return dict.fromkeys(updates, self._counts(self._settings.support_batches, self._settings.query_batches))

    def weights(self) -> dict[str, npt.NDArray[np.float32]]:
        """A copy of the meta-model's parameters, as it goes down (see `MetaModel.weights`)."""
        return self.meta_model.weights()

    def state(self) -> State:
        """See `common.disk.state.Stateful`."""
        state = {f"model/{name}": value.detach() for name, value in self._leaves.items()}
        for task, target in self._targets.items():
            state |= {f"target/{task}/{name}": value for name, value in target.items()}
        for name, leaf in self._leaves.items():
            state |= {f"adam/{name}/{key}": value for key, value in self._optimizer.state[leaf].items()}
        tensors = State({name: value.cpu().contiguous().numpy() for name, value in state.items()})
        replays = {f"replay-{task}": held.state() for task, held in self._replays.items()}
        walks = {f"walks-{task}": held.state() for task, held in self._walks.items()}
        return State.of({"learner": tensors, **replays, **walks})

    def load_state(self, state: State) -> None:
        """See `common.disk.state.Stateful`."""
        found = {name: torch.from_numpy(np.array(array)) for name, array in state.part("learner").arrays.items()}
        for task, target in self._targets.items():
            for name, value in target.items():
                value.copy_(found[f"target/{task}/{name}"])
        for name, leaf in self._leaves.items():
            with torch.no_grad():
                leaf.copy_(found[f"model/{name}"])
            moments = {key: found[f"adam/{name}/{key}"] for key in ("step", "exp_avg", "exp_avg_sq")}
            self._optimizer.state[leaf] = {
                key: value.to(leaf.device) if key == "step" else torch.empty_like(leaf).copy_(value)
                for key, value in moments.items()
            }
        for task, held in self._replays.items():
            held.load_state(state.part(f"replay-{task}"))
            self._walks[task].load_state(state.part(f"walks-{task}"))

    def _counts(self, support: int, query: int) -> Gradients:
        """Batches as gradients: Reptile's and joint training's are all of one kind."""
        plain = self._method in ("reptile", "multitask")
        return Gradients(support + query, 0) if plain else Gradients(support, query)

    def _replay(self, task: int, folder: Path | None) -> Replay:
        learning = self._scenario.learning
        spare = 2 * learning.motions_per_round * len(self._scenario.training_agents[task])
        frames = folder and folder / f"frames-{task}.bin"
        return Replay(self._settings.replay_size, self._model.takes, frames, spare)

    def _gradient(self, task: int, batches: Batches) -> tuple[Params, Params]:
        """A task's meta-gradient and the model that its target network follows."""
        settings, learning = self._settings, self._scenario.learning
        params = self.meta_model.params(task)
        loss: Loss = make_loss(self._model, self._targets[task], learning.discount, double=learning.double)
        if self._method == "multitask":
            (batch,) = batches.support
            return plain_gradient(lambda at: loss(at, batch), params), params
        if self._method == "reptile":
            every = [*batches.support, *batches.query]
            return reptile_gradient(params, every, loss, settings.inner_lr, learning.grad_clip)
        return meta_gradient(
            params,
            *batches,
            loss,
            settings.inner_lr,
            exact=self._method != "fomaml",
            clip=learning.grad_clip,
            inner=self._head if self._method == "anil" else None,
        )

    def _draw(self, task: int, round_: int) -> Batches:
        settings, replay = self._settings, self._replays[task]
        rng = stream(self._scenario.seed, "meta", "batches", task, round_)
        # A robot adapts on what it has just seen, so that is what the adaptation is rehearsed on.
        newest = settings.support_newest * len(self._scenario.training_agents[task])
        support = [replay.sample(settings.batch_size, rng, newest) for _ in range(settings.support_batches)]
        query = [replay.sample(settings.batch_size, rng) for _ in range(settings.query_batches)]
        return Batches(
            [to_tensors(each, self._model, self._device) for each in support],
            [to_tensors(each, self._model, self._device) for each in query],
        )

    def _split(self, batches: Batches) -> list[Batches]:
        """A round's batches by meta-update."""
        if self._method == "multitask":
            return [Batches([each], []) for each in (*batches.support, *batches.query)]
        inner = self._settings.inner_steps
        updates = len(batches.support) // inner
        outer = len(batches.query) // updates
        return [
            Batches(batches.support[i * inner : (i + 1) * inner], batches.query[i * outer : (i + 1) * outer])
            for i in range(updates)
        ]

    def _update(self, round_: int) -> None:
        leaves = list(self._leaves.values())
        norm = torch.nn.utils.clip_grad_norm_(leaves, self._scenario.learning.grad_clip, foreach=True)
        if not torch.isfinite(norm):
            raise TrainingError(f"meta-gradient of round {round_} is not finite; lower meta.inner_lr or meta.meta_lr")
        self._optimizer.step()
