"""The meta-learner's state: meta-model, its optimizer, and each training task's replay and target network."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch.func import grad

from common.errors import TrainingError
from common.methods import Method
from common.qnetwork import build_qnetwork, to_weights
from common.replay import Replay
from common.scenario import Scenario
from common.seeding import integer, stream
from datacenter.maml import Loss, Params, TensorBatch, head_of, make_loss, meta_gradient, reptile_gradient, to_tensors
from datacenter.motions import Motion, remember


@dataclass(frozen=True)
class Gradients:
    """Batch gradients computed for one task in one round."""

    support: int
    query: int


class MetaLearner:
    """One meta method, round by round, on a CUDA device where there is one."""

    def __init__(self, scenario: Scenario, method: Method) -> None:
        self._scenario, self._settings, self._method = scenario, scenario.meta, method
        self._device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self._model = build_qnetwork(scenario.network, integer(scenario.seed, "initial meta-model")).to(self._device)
        self._parameters = list(self._model.parameters())
        self._optimizer = torch.optim.Adam(self._parameters, lr=self._settings.meta_lr, fused=True)
        self._targets: dict[int, Params] = {
            task: {name: value.detach().clone() for name, value in self._model.named_parameters()}
            for task in self._settings.training_tasks
        }
        network = scenario.network
        self._replays = {
            task: Replay(self._settings.replay_size, network.height, network.width)
            for task in self._settings.training_tasks
        }

    def remember(self, task: int, motions: list[Motion]) -> None:
        """Put one robot's motions of one round into the task's replay."""
        remember(self._replays[task], motions)

    def learn(self, round_: int) -> dict[int, Gradients]:
        """One round over all training tasks; returns the gradients computed for each.

        Random draws depend on seed, round and task only, so that a round resumed is the round undisturbed.

        Raises:
            TrainingError: a meta-gradient is not finite.
        """
        batches = {task: self._draw(task, round_) for task in self._settings.training_tasks}
        if self._method == "multitask":
            return self._learn_jointly(batches, round_)
        total = [torch.zeros_like(value) for value in self._parameters]
        for task, (support, query) in batches.items():
            gradient, adapted = self._gradient(task, support, query)
            torch._foreach_add_(total, list(gradient.values()))
            self._track(task, adapted, self._settings.target_polyak)
        self._update(total, round_)
        if self._method == "reptile":  # every batch is one of the adaptation
            return {task: Gradients(len(support) + len(query), 0) for task, (support, query) in batches.items()}
        return {task: Gradients(len(support), len(query)) for task, (support, query) in batches.items()}

    def _gradient(self, task: int, support: list[TensorBatch], query: list[TensorBatch]) -> tuple[Params, Params]:
        """A task's meta-gradient and its adapted model."""
        settings, clip = self._settings, self._scenario.learning.grad_clip
        params, loss = self._params(), self._loss(task)
        if self._method == "reptile":
            return reptile_gradient(params, [*support, *query], loss, settings.inner_lr, clip)
        inner = head_of(self._model) if self._method == "anil" else None
        exact = self._method != "fomaml"
        return meta_gradient(params, support, query, loss, settings.inner_lr, exact=exact, clip=clip, inner=inner)

    def _learn_jointly(
        self, batches: dict[int, tuple[list[TensorBatch], list[TensorBatch]]], round_: int
    ) -> dict[int, Gradients]:
        """Joint training: one step on a batch of every task at once, as many steps as there are batches."""
        lists = {task: [*support, *query] for task, (support, query) in batches.items()}
        for step in zip(*lists.values(), strict=True):
            params = self._params()
            total = [torch.zeros_like(value) for value in self._parameters]
            for task, batch in zip(lists, step, strict=True):
                torch._foreach_add_(total, list(grad(self._loss(task))(params, batch).values()))
            self._update(total, round_)
            for task in lists:
                self._track(task, self._params(), self._scenario.learning.target_polyak)
        return {task: Gradients(len(each), 0) for task, each in lists.items()}

    def _params(self) -> Params:
        return {name: value.detach() for name, value in self._model.named_parameters()}

    def _loss(self, task: int) -> Loss:
        learning = self._scenario.learning
        return make_loss(self._model, self._targets[task], learning.discount, double=learning.double)

    def weights(self) -> dict[str, npt.NDArray[np.float32]]:
        """A copy of the meta-model's parameters."""
        return to_weights(self._model)

    @property
    def fingerprint(self) -> str:
        """Of all that the training depends on: a state goes on bit by bit only where this is the same."""
        settings = self._scenario.model_dump_json(exclude={"name", "energy", "bus"})
        return hashlib.sha256(f"{self._method} {settings}".encode()).hexdigest()

    def state(self) -> dict[str, Tensor]:
        """Everything that `load_state` needs to go on, as named tensors (replay apart)."""
        named = dict(self._model.named_parameters())
        state = {f"model/{name}": value.detach() for name, value in named.items()}
        for task, target in self._targets.items():
            state |= {f"target/{task}/{name}": value for name, value in target.items()}
        for name, parameter in named.items():
            state |= {f"adam/{name}/{key}": value for key, value in self._optimizer.state[parameter].items()}
        return {name: value.cpu().contiguous() for name, value in state.items()}

    def load_state(self, state: dict[str, Tensor]) -> None:
        """Take up a state saved by `state`."""
        for name, parameter in self._model.named_parameters():
            with torch.no_grad():
                parameter.copy_(state[f"model/{name}"])
            for task in self._targets:
                self._targets[task][name].copy_(state[f"target/{task}/{name}"])
            moments = {key: state[f"adam/{name}/{key}"].clone() for key in ("step", "exp_avg", "exp_avg_sq")}
            self._optimizer.state[parameter] = {
                key: value.to(parameter.device) if key == "step" else torch.empty_like(parameter).copy_(value)
                for key, value in moments.items()
            }

    def _draw(self, task: int, round_: int) -> tuple[list[TensorBatch], list[TensorBatch]]:
        settings, replay = self._settings, self._replays[task]
        rng = stream(self._scenario.seed, "meta", "batches", task, round_)
        # A robot adapts on what it has just seen, so that is what the adaptation is rehearsed on.
        newest = settings.support_newest * len(self._scenario.training_agents[task])
        support = [replay.sample(settings.batch_size, rng, newest) for _ in range(settings.support_batches)]
        query = [replay.sample(settings.batch_size, rng) for _ in range(settings.query_batches)]
        return [to_tensors(each, self._device) for each in support], [to_tensors(each, self._device) for each in query]

    def _track(self, task: int, adapted: Params, rate: float) -> None:
        """The task's target network q~ follows its adapted models."""
        torch._foreach_lerp_(list(self._targets[task].values()), list(adapted.values()), rate)

    def _update(self, gradients: list[Tensor], round_: int) -> None:
        for parameter, gradient in zip(self._parameters, gradients, strict=True):
            parameter.grad = gradient / len(self._settings.training_tasks)
        norm = torch.nn.utils.clip_grad_norm_(self._parameters, self._scenario.learning.grad_clip, foreach=True)
        if not torch.isfinite(norm):
            raise TrainingError(f"meta-gradient of round {round_} is not finite; lower meta.inner_lr or meta.meta_lr")
        self._optimizer.step()
