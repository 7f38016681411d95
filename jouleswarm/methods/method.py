"""A method: one way for a cluster to learn, all of it in one class (docs/doors.md).

The core asks what a method is, `stage`, `partners` and `sends`, and never what it is called. Nothing here loads
PyTorch: the command line and the recorder open methods for their labels and closed forms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

from jouleswarm.common.disk.state import State
from jouleswarm.common.meter.work import TallyOf
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.types import Weights
from jouleswarm.energy.closed_form import ClusterRounds, RoundSizes, closed_form
from jouleswarm.energy.facts import Counts, StageCounts
from jouleswarm.methods.mixing import mix, mixing_weights, weighted_average

if TYPE_CHECKING:
    from torch import Tensor

    from jouleswarm.learning.learner import Learner
    from jouleswarm.learning.replay import Replay

    Params = Mapping[str, Tensor]

Partners = Literal["neighbours", "datacenter", "nobody"]
Sends = Literal["weights", "experience"]

DATACENTER = 0
"""Its id among the partners of a robot."""


@dataclass(frozen=True)
class Update:
    """What has come of one partner in a round."""

    weights: Weights
    """float32, not to be changed: the partner's model, as the codec decodes it."""
    samples: int
    """|E_h|: transitions that are new in this round; of the data center its cluster's."""
    round: int


@dataclass(frozen=True)
class ClusterRound:
    """A round of one cluster in the data center, once all of it has come."""

    task: int
    round: int
    updates: Mapping[int, Update]
    """Robot -> its update, in the order of ids; none where robots send experience."""
    learner: Learner | None = None
    """Where robots send experience: Q-network, optimizer and one memory of all that the cluster's robots sent."""
    batches: int = 0
    """Gradient steps that its robots would have taken together, sum over k of B_ik."""


@dataclass(frozen=True)
class Gradients:
    """Batch gradients that a stage computed for one task in one round."""

    support: int
    """Plain ones: on B^(a), and all others that go back through nothing."""
    query: int = 0
    """On B^(b); each costs beta plain ones where the method is `exact`."""


Replays = Mapping[int, "Mapping[int, Replay]"]
"""Training task -> robot k -> its experience E_ik so far."""


class Stage(Protocol):
    """What the data center trains before, for robots to start from; on their experience, round by round."""

    tally: TallyOf
    """Set by the core: `tally(task).gradients(plain, query)` books batch gradients as they are computed, so that those
    of a round that has to be done again are paid for as well. A stage that does not call it is billed by its rows."""

    def learn(self, round_: int, replays: Replays) -> Mapping[int, Gradients]:
        """One round over all training tasks; what was computed for each."""

    def weights(self) -> Weights:
        """The model that goes down: the network, and its heads where `Method.heads` names tasks (learning/heads.py)."""

    def beta(self) -> float:
        """Cost of an exact gradient on B^(b) over a plain one, measured; 1 where nothing goes back through it."""

    def state(self) -> State:
        """See `common.disk.state.Stateful`."""

    def load_state(self, state: State) -> None:
        """See `common.disk.state.Stateful`."""


class Method:
    """A way to learn; override what differs. As it stands: decentralized federated averaging, eq. (6)."""

    name: str = ""
    """A level of every topic and of file names; no two methods of a run share one."""
    label: str = ""
    """In tables and figures; default: the name."""
    colour: str = "#7F7F7F"
    """In figures."""
    partners: Partners = "neighbours"
    """Whom a robot's round meets."""
    sends: Sends = "weights"
    """What a robot gives them; experience goes to the data center alone."""
    exact: bool = False
    """Whether the stage differentiates through its adaptation: its gradients on B^(b) then cost beta, eq. (9)."""
    in_paper: bool = False
    """Whether the paper prints energies of it."""
    stage: Callable[[Scenario], Stage] | None = None
    """Makes what is trained in the data center before; None: robots start from random weights."""

    def heads(self, scenario: Scenario) -> tuple[int, ...]:
        """Tasks that the stage's model has a last layer of their own for."""
        return scenario.meta.training_tasks if scenario.meta.heads == "per_task" else ()

    def penalty(self, params: Params, start: Params) -> Tensor | float:
        """Added to the loss of eq. (7) in every gradient step; `start` are the parameters at the round's beginning."""
        return 0.0

    @property
    def own_penalty(self) -> Callable[[Params, Params], Tensor | float] | None:
        """`penalty` where it is overridden, for the core; None: nothing is added."""
        return None if type(self).penalty is Method.penalty else self.penalty

    def mix(self, own: Weights, theirs: Mapping[int, Update], step: float) -> Weights:
        """The robot's model after a round, float32 in the shapes of `own`; nothing may be changed in place.

        Args:
            own: W_k, the robot's own model.
            theirs: partner -> what came of it, in the order of ids, one or more; the data center is 0.
            step: `federation.step`, or its default for so many neighbours.

        Default: eq. (6), sigma by |E_h|; from the data center, its model.
        """
        if self.partners == "datacenter":
            return dict(theirs[DATACENTER].weights)
        others = {agent: update.weights for agent, update in theirs.items()}
        return mix(own, others, mixing_weights({agent: update.samples for agent, update in theirs.items()}), step)

    def mix_lossy(self, own: Weights, told: Weights, theirs: Mapping[int, Update], step: float) -> Weights:
        """`mix` where the codec is lossy and partners hold `told` of this robot, not `own`.

        Default: what is told is mixed, and what the message could not tell stays on top (error feedback).
        """
        mixed = self.mix(told, theirs, step)
        return {name: mixed[name] + (tensor - told[name]) for name, tensor in own.items()}

    def serve(self, round_: ClusterRound) -> tuple[Weights, int]:
        """In the data center, where that is the partner: the model for the cluster, and the batch gradients it took.

        Default: the average of the robots' models, weighed by |E_k|; no gradient is computed.
        """
        updates = round_.updates.values()
        return weighted_average([each.weights for each in updates], [each.samples for each in updates]), 0

    def state(self) -> State:
        """What a method of yours remembers from round to round (see `common.disk.state.Stateful`); default: nothing.

        There is an object for each robot and arm, and in the data center one for each cluster.
        """
        return State()

    def load_state(self, state: State) -> None:
        """Take up what `state` returned."""

    def closed_form(self, scenario: Scenario, t0: float, rounds: Mapping[int, float], sizes: RoundSizes) -> StageCounts:
        """What the method computes and moves by its equations: (9) and (11), and their like.

        Args:
            scenario: who the robots of each task are.
            t0: rounds of the stage, 0 without.
            rounds: t_i by task, the mean over its robots where each stops by itself.
            sizes: of a round: batches and bytes.

        Default by `partners` and `sends`. A message of weights goes over every directed link, or up and an answer down;
        first messages are whole whatever the codec.
        """
        clusters = [self._cluster(scenario, task, task_rounds, sizes) for task, task_rounds in rounds.items()]
        training = [agent for agents in scenario.training_agents.values() for agent in agents] if t0 else []
        meta_model_bytes = sizes.meta_model_of.get(self.name)
        counts = closed_form(t0, len(training), clusters, sizes, sizes.experience(training), meta_model_bytes)
        if self.partners == "datacenter":
            return StageCounts(counts.ml, self._served(scenario, rounds, sizes, counts.fl.gradients_robots))
        return counts

    def _cluster(self, scenario: Scenario, task: int, rounds: float, sizes: RoundSizes) -> ClusterRounds:
        from jouleswarm.methods.graph import directed_links

        robots = scenario.cluster(task)
        links = directed_links(scenario, task) if self.partners == "neighbours" else 0
        return ClusterRounds(rounds, len(robots), links, sizes.batches(robots))

    def _served(self, scenario: Scenario, rounds: Mapping[int, float], sizes: RoundSizes, gradients: float) -> Counts:
        models_bytes = sum(
            len(scenario.cluster(task)) * (task_rounds * sizes.weights_bytes + sizes.base_bytes)
            for task, task_rounds in rounds.items()
            if task_rounds
        )
        if self.sends == "weights":
            return Counts(gradients_robots=gradients, uplink_bytes=models_bytes, downlink_bytes=models_bytes)
        experience_bytes = sum(
            task_rounds * sizes.experience(scenario.cluster(task)) for task, task_rounds in rounds.items()
        )
        return Counts(gradients_support=gradients, uplink_bytes=experience_bytes, downlink_bytes=models_bytes)
