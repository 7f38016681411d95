"""A Q-network in use: a policy that acts, and a learner that improves it on replayed transitions."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from jouleswarm.common.disk.state import State, generator_state, load_generator
from jouleswarm.common.errors import TrainingError
from jouleswarm.common.meter.work import Tally
from jouleswarm.common.scenario.sections import Learning as LearningSettings
from jouleswarm.common.wire.types import Weights
from jouleswarm.learning.dqn import polyak_update, td_slope, td_target
from jouleswarm.learning.flat import Flat
from jouleswarm.learning.networks import load_weights, to_weights
from jouleswarm.learning.optimizers import Adam, Sgd
from jouleswarm.learning.passes import pass_of, values_of
from jouleswarm.learning.qnetwork import QNetwork
from jouleswarm.learning.replay import Batch, Replay

Penalty = Callable[[Mapping[str, Tensor], Mapping[str, Tensor]], Tensor | float]
"""Of the parameters, and of those at the round's beginning."""


class Policy:
    """A Q-network that is asked for values and given weights."""

    def __init__(self, network: QNetwork, weights: Weights) -> None:
        """`network`: taken over."""
        self.online = network
        self._values = values_of(network)
        load_weights(self.online, weights)

    def q_values(self, frame: npt.NDArray[Any]) -> Tensor:
        """Q of one observation as it is kept -> float32 [actions]."""
        with torch.inference_mode():
            return self._values(self.online.prepare(frame[np.newaxis]))[0]

    def weights(self) -> Weights:
        """A copy of the network's parameters."""
        return to_weights(self.online)

    def state(self) -> State:
        return State(to_weights(self.online))

    def load_state(self, state: State) -> None:
        load_weights(self.online, state.arrays)

    def set_weights(self, weights: Weights) -> None:
        """Take over parameters; whatever else a learner holds (moments, target) stays its own."""
        load_weights(self.online, weights)


class Learner(Policy):
    """Deep Q-learning of eq. (7): online and target network, optimizer, replay."""

    def __init__(
        self,
        network: QNetwork,
        settings: LearningSettings,
        weights: Weights,
        rng: np.random.Generator,
        replay_file: Path | None = None,
        tally: Tally | None = None,
        penalty: Penalty | None = None,
    ) -> None:
        """`replay_file`: where the replay memory keeps its frames, for who wants to go on from a state.

        `tally`: counts each batch gradient as it is computed, also of a round that is not kept; `penalty`: added to
        every loss.
        """
        super().__init__(network, weights)
        self._settings = settings
        self._rng = rng
        self._tally = tally or Tally()
        self._penalty = penalty
        self._start: dict[str, Tensor] = {}
        self._target = copy.deepcopy(network).requires_grad_(False)
        self._flat, self._flat_target = Flat(self.online, gradients=True), Flat(self._target)
        self._pass, self._values_of_target = pass_of(self.online), values_of(self._target)
        self._optimizer = _optimizer(settings, self._flat.values)
        # A round's motions, each of which may open an episode with a frame more.
        spare = 2 * settings.motions_per_round
        self.replay = Replay(settings.replay_size, network.takes, replay_file, spare)
        self.steps = 0

    def learn(self, batches: int) -> int:
        """Take `batches` gradient steps on replayed transitions; returns the batch gradients computed.

        Raises:
            TrainingError: the loss is not finite.
        """
        if not len(self.replay):
            return 0
        if self._penalty is not None:
            self._start = {name: value.detach().clone() for name, value in self.online.named_parameters()}
        drawn = [self.replay.sample(self._settings.batch_size, self._rng) for _ in range(batches)]
        next_q = self._next_q_in_one_batch(drawn) if self._target_rests(batches) else None
        losses = [self._step(batch, next_q[index] if next_q is not None else None) for index, batch in enumerate(drawn)]
        if not math.isfinite(float(torch.stack(losses).sum())):
            raise TrainingError(f"loss is not finite after {self.steps} gradient steps; lower learning.lr")
        return len(losses)

    def state(self) -> State:
        moments = {f"{index}/{key}": value for index, key, value in self._moments()}
        parts = {
            "online": super().state(),
            "target": State(to_weights(self._target)),
            "moments": State({name: value.contiguous().numpy() for name, value in moments.items()}),
            "replay": self.replay.state(),
            "learner": State(values={"steps": self.steps, "rng": generator_state(self._rng)}),
        }
        return State.of(parts)

    def load_state(self, state: State) -> None:
        super().load_state(state.part("online"))
        load_weights(self._target, state.part("target").arrays)
        held = self._optimizer.state[self._flat.values]
        for name, array in state.part("moments").arrays.items():
            index, key = name.split("/")
            whole = held.setdefault(key, torch.zeros_like(self._flat.values) if array.ndim else torch.zeros(()))
            part = list(self._flat.views(whole))[int(index)] if array.ndim else whole
            part.copy_(torch.from_numpy(np.array(array)))
        self.replay.load_state(state.part("replay"))
        values = state.part("learner").values
        self.steps = values["steps"]
        load_generator(self._rng, values["rng"])

    def _moments(self) -> Iterator[tuple[int, str, Tensor]]:
        for key, value in self._optimizer.state.get(self._flat.values, {}).items():
            parts = self._flat.views(value) if value.dim() else [value] * len(list(self.online.parameters()))
            for index, part in enumerate(parts):
                yield index, key, part

    @torch.no_grad()
    def _step(self, batch: Batch, next_q_target: Tensor | None) -> Tensor:
        settings, learned = self._settings, len(batch.frames)
        frames = self.online.prepare(np.concatenate((batch.frames, batch.next_frames)))
        # The online network says in one pass what is learned on, and what double learning would do next.
        values, backward = self._pass(frames if settings.double else frames[:learned], learned)
        target_values = self._values_of_target(frames[learned:]) if next_q_target is None else next_q_target
        target = td_target(
            torch.from_numpy(batch.rewards),
            torch.from_numpy(batch.terminated),
            values[learned:],
            target_values,
            settings.discount,
            double=settings.double,
        )
        loss, slope = td_slope(values[:learned], torch.from_numpy(batch.actions), target)
        backward(slope)
        if self._penalty is not None:
            loss = loss + self._add_penalty()
        self._flat.clip(settings.grad_clip)
        self._optimizer.step()
        self.steps += 1
        self._tally.gradients()
        if self.steps % settings.target_every == 0:
            polyak_update([self._flat_target.values], [self._flat.values], settings.target_polyak)
        return loss

    @torch.enable_grad()
    def _add_penalty(self) -> Tensor:
        """Its gradient to the loss's; returns it, detached."""
        assert self._penalty is not None
        penalty = torch.as_tensor(self._penalty(dict(self.online.named_parameters()), self._start))
        if penalty.requires_grad:
            penalty.backward()  # type: ignore[no-untyped-call]
        return penalty.detach()

    def _target_rests(self, batches: int) -> bool:
        """Whether the target network stays as it is until the last of the next `batches` steps."""
        every = self._settings.target_every
        return self.steps // every == (self.steps + batches - 1) // every

    def _next_q_in_one_batch(self, drawn: list[Batch]) -> Tensor:
        frames = np.concatenate([batch.next_frames for batch in drawn])
        with torch.no_grad():
            values = self._values_of_target(self._target.prepare(frames))
        return values.reshape(len(drawn), -1, values.shape[1])


def _optimizer(settings: LearningSettings, parameters: Tensor) -> Adam | Sgd:
    if settings.optimizer == "sgd":
        return Sgd([parameters], settings.lr)
    return Adam([parameters], settings.lr, settings.adam_eps)
