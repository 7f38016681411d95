"""The meta-learner's state: meta-model, its optimizer, and each training task's target network."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from jouleswarm.common.disk.state import State
from jouleswarm.common.errors import TrainingError
from jouleswarm.common.meter.work import TallyOf, nobody
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.seeding import integer, stream
from jouleswarm.common.wire.types import Weights
from jouleswarm.learning.device import compute_device
from jouleswarm.learning.metamodel import MetaModel
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.learning.optimizers import Adam
from jouleswarm.learning.passes import Params
from jouleswarm.learning.replay import Replay
from jouleswarm.learning.start import saved_start
from jouleswarm.learning.task_loss import make_loss, sum_of, to_tensors
from jouleswarm.methods.beta import measure_beta
from jouleswarm.methods.method import Gradients, Replays
from jouleswarm.methods.rehearsal import MetaRule, Rehearsal, Samples


class MetaStage:
    """One meta method, round by round, on a CUDA device where there is one."""

    def __init__(self, scenario: Scenario, method: MetaRule) -> None:
        self.tally: TallyOf = nobody
        self._scenario, self._settings, self._method = scenario, scenario.meta, method
        self._device = compute_device()
        self._model = build_qnetwork(scenario, integer(scenario.seed, "initial meta-model")).to(self._device)
        learns_rates = method.learns_rates and self._settings.inner_lr_step > 0
        mu = self._settings.inner_lr if learns_rates else None
        self.meta_model = MetaModel(self._model, method.heads(scenario), mu)
        if (saved := saved_start(scenario)) is not None:
            self._begin_from(saved)
        leaves, rates = dict(self.meta_model.named()), self.meta_model.rates
        self._leaves = leaves | rates
        self._of_leaves = Adam(leaves.values(), self._settings.meta_lr)
        self._of_rates = Adam(rates.values(), self._settings.inner_lr_step)
        self._targets: dict[int, Params] = {
            task: {name: value.clone() for name, value in self.meta_model.params(task).items()}
            for task in self._settings.training_tasks
        }

    def _begin_from(self, saved: Weights) -> None:
        """A model of an earlier run; a head that it does not have begins as the network's own last layer."""
        for name, leaf in self.meta_model.named():
            with torch.no_grad():
                leaf.copy_(torch.from_numpy(saved[name if name in saved else name.partition("/")[2]]))

    def learn(self, round_: int, replays: Replays) -> dict[int, Gradients]:
        """One round over all training tasks; returns the gradients computed for each.

        B^(a) support and B^(b) query batches of each of a task's robots make B^(a) / inner_steps meta-updates (joint
        training: one for each batch). Losses and gradients are sums over a task's robots, eqs. (1) and (3), and means
        over tasks. Random draws depend on seed, round and task only, so that a round resumed is the round undisturbed.

        Raises:
            TrainingError: a meta-gradient is not finite.
        """
        settings, method = self._settings, self._method
        robots = {task: len(held) for task, held in replays.items()}
        updates = {
            task: method.updates(self._draw(task, round_, held), settings.inner_steps) for task, held in replays.items()
        }
        a_round = len(next(iter(updates.values())))
        for index, update in enumerate(zip(*updates.values(), strict=True)):
            unseen = settings.rehearse_unseen and ((round_ - 1) * a_round + index) % 2 == 1
            self.meta_model.zero_gradients()
            for task, samples in zip(updates, update, strict=True):
                gradient, adapted = method.gradient(self._rehearsal(task, samples, unseen=unseen))
                done = self._counts(robots[task] * len(samples.support), robots[task] * len(samples.query))
                self.tally(task).gradients(done.support, done.query)
                self.meta_model.add_gradient(task, gradient, 1 / len(updates), unseen=unseen)
                if not unseen:  # targets tell what the task's own head knows
                    target = list(self._targets[task].values())
                    torch._foreach_lerp_(target, list(adapted.values()), settings.target_polyak)
            self._update(round_)
        return {
            task: self._counts(count * settings.support_batches, count * settings.query_batches)
            for task, count in robots.items()
        }

    def beta(self) -> float:
        """See `methods.method.Stage`; timed on made-up batches."""
        if not self._method.exact:
            return 1.0
        return measure_beta(self._scenario, self._method.inner(self._model)).beta_time

    def weights(self) -> dict[str, npt.NDArray[np.float32]]:
        """A copy of the meta-model's parameters, as it goes down (see `MetaModel.weights`)."""
        return self.meta_model.weights()

    def state(self) -> State:
        state = {f"model/{name}": value.detach() for name, value in self._leaves.items()}
        for task, target in self._targets.items():
            state |= {f"target/{task}/{name}": value for name, value in target.items()}
        for name, leaf in self._leaves.items():
            state |= {f"adam/{name}/{key}": value for key, value in self._moments(name)[leaf].items()}
        return State({name: value.cpu().contiguous().numpy() for name, value in state.items()})

    def load_state(self, state: State) -> None:
        found = {name: torch.from_numpy(np.array(array)) for name, array in state.arrays.items()}
        for task, target in self._targets.items():
            for name, value in target.items():
                value.copy_(found[f"target/{task}/{name}"])
        for name, leaf in self._leaves.items():
            with torch.no_grad():
                leaf.copy_(found[f"model/{name}"])
            moments = {key: found[f"adam/{name}/{key}"] for key in ("step", "exp_avg", "exp_avg_sq")}
            self._moments(name)[leaf] = {
                key: value.to(leaf.device) if key == "step" else torch.empty_like(leaf).copy_(value)
                for key, value in moments.items()
            }

    def _moments(self, name: str) -> dict[Tensor, dict[str, Tensor]]:
        """By leaf; those of the leaf of this name are among them."""
        return (self._of_rates if name in self.meta_model.rates else self._of_leaves).state

    def _counts(self, support: int, query: int) -> Gradients:
        """Batches as gradients: Reptile's and joint training's are all of one kind."""
        return Gradients(support + query) if self._method.plain else Gradients(support, query)

    def _rehearsal(self, task: int, samples: Samples, *, unseen: bool) -> Rehearsal:
        learning = self._scenario.learning
        loss = sum_of(make_loss(self._model, self._targets[task], learning.discount, double=learning.double))
        params, inner = self.meta_model.params(task, unseen=unseen), self._method.inner(self._model)
        rates = {key: log_mu.detach() for key, log_mu in self.meta_model.rates.items()}
        return Rehearsal(params, samples, loss, rates or self._settings.inner_lr, learning.grad_clip, inner)

    def _draw(self, task: int, round_: int, replays: Mapping[int, Replay]) -> Samples:
        settings = self._settings
        rng = stream(self._scenario.seed, "meta", "batches", task, round_)
        support, query = [], []
        for replay in replays.values():
            # A robot adapts on what it has just seen, so that is what the adaptation is rehearsed on.
            newest = settings.support_newest
            support.append([replay.sample(settings.batch_size, rng, newest) for _ in range(settings.support_batches)])
            query.append([replay.sample(settings.batch_size, rng) for _ in range(settings.query_batches)])
        on_device = [
            [
                tuple(to_tensors(each, self._model, self._device) for each in sample)
                for sample in zip(*drawn, strict=True)
            ]
            for drawn in (support, query)
        ]
        return Samples(*on_device)

    def _update(self, round_: int) -> None:
        leaves = list(self._leaves.values())
        norm = torch.nn.utils.clip_grad_norm_(leaves, self._scenario.learning.grad_clip, foreach=True)
        if not torch.isfinite(norm):
            raise TrainingError(f"meta-gradient of round {round_} is not finite; lower meta.inner_lr or meta.meta_lr")
        self._of_leaves.step()
        if self.meta_model.rates:
            self._of_rates.step()
