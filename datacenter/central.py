"""Deep Q-learning in the data center on the robots' raw observations: the `centralized` method's work in a round."""

from __future__ import annotations

from pathlib import Path

from jouleswarm.codecs.streams import WeightsEncoder
from jouleswarm.common.bus.bus import Payload
from jouleswarm.common.disk.state import State
from jouleswarm.common.errors import PayloadError
from jouleswarm.common.meter.work import TallyOf, nobody
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.seeding import integer, stream
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.datacenter.cluster_rounds import Turn
from jouleswarm.datacenter.experience import Motion, Walks, read_motion
from jouleswarm.learning.learner import Learner
from jouleswarm.learning.networks import build_qnetwork, to_weights

METHOD = "centralized"


class CentralLearner:
    """One learner a task, with all its robots' transitions and as many gradient steps as they would have taken."""

    word = "experience"

    def __init__(self, scenario: Scenario, folder: Path | None = None, tally: TallyOf = nobody) -> None:
        """`folder`: for the frames of the replay memories; `tally`: counts batch gradients as they are computed."""
        self._scenario, self._folder, self._tally = scenario, folder, tally
        self.per_robot = scenario.learning.motions_per_round
        self._learners = {task: self._learner(task) for task in scenario.clusters}
        self._walks = {task: Walks(learner.replay, self.per_robot) for task, learner in self._learners.items()}
        self._encoders = {task: WeightsEncoder(scenario.federation.weights_codec) for task in scenario.clusters}

    def read(self, payload: Payload, task: int, agent: int) -> tuple[int, int, Motion]:
        """One motion of a robot.

        Raises:
            PayloadError: not a motion of this robot.
        """
        motion = read_motion(payload, self._scenario)
        header = motion.header
        if (header.task, header.agent) != (task, agent):
            raise PayloadError(
                f"experience of robot {header.agent}, task {header.task}; expected robot {agent}, task {task}"
            )
        return header.round, header.motion, motion

    def model(self, turn: Turn[Motion]) -> tuple[bytes, int]:
        """The task's model after this round's steps as payload, and the batch gradients computed."""
        learner = self._learners[turn.task]
        for _, motions in sorted(turn.arrived.items()):
            self._walks[turn.task].remember(motions)
        gradients = learner.learn(self._scenario.learning.batches_per_round * len(turn.arrived))
        header = ModelHeader(task=turn.task, agent=0, round=turn.round)
        return self._encoders[turn.task].payload(learner.weights(), header), gradients

    def state(self, task: int) -> State:
        """See `datacenter.cluster_rounds.Service`."""
        learner, walks, encoder = self._learners[task], self._walks[task], self._encoders[task]
        return State.of({"learner": learner.state(), "walks": walks.state(), "encoder": encoder.state()})

    def load_state(self, task: int, state: State) -> None:
        """See `datacenter.cluster_rounds.Service`."""
        self._learners[task].load_state(state.part("learner"))
        self._walks[task].load_state(state.part("walks"))
        self._encoders[task].load_state(state.part("encoder"))

    def _learner(self, task: int) -> Learner:
        scenario = self._scenario
        # All robots' transitions in one memory, of the size that theirs have together.
        robots, learning = len(scenario.cluster(task)), scenario.learning
        sizes = {"replay_size": robots * learning.replay_size, "motions_per_round": robots * learning.motions_per_round}
        settings = learning.model_copy(update=sizes)
        weights = to_weights(build_qnetwork(scenario, integer(scenario.seed, "initial weights", task)))
        frames = self._folder / f"frames-{task}.bin" if self._folder else None
        rng = stream(scenario.seed, METHOD, "learn", task)
        return Learner(build_qnetwork(scenario), settings, weights, rng, frames, self._tally(task))
