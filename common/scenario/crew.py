"""Who learns what: the robots of a scenario, in clusters, and what each does in a round."""

from __future__ import annotations

from functools import cached_property

from pydantic import Field

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.problem import Problem
from jouleswarm.common.scenario.robots import Robot
from jouleswarm.common.scenario.sections import Federation, Learning, Meta, Starts


class Crew(Problem):
    """A problem and the robots that learn its tasks."""

    robots: tuple[Robot, ...] = Field(
        (), max_length=1000, description="[[robots]]: those with a round or constants of their own"
    )
    learning: Learning = Learning()
    federation: Federation = Federation()
    meta: Meta = Meta()

    @cached_property
    def clusters(self) -> dict[int, tuple[int, ...]]:
        """Task id -> ids of its robots; robots are numbered from 1 in the order of the tasks."""
        clusters, next_id = {}, 1
        for task in self.tasks:
            size = task.robots or self.federation.robots_per_cluster
            clusters[task.id] = tuple(range(next_id, next_id + size))
            next_id += size
        return clusters

    def cluster(self, task: int) -> tuple[int, ...]:
        """Ids of the robots that learn `task`."""
        return self.clusters[task]

    def task_of(self, agent: int) -> int:
        """The task that robot `agent` learns.

        Raises:
            ConfigurationError: no such robot.
        """
        for task, agents in self.clusters.items():
            if agent in agents:
                return task
        raise ConfigurationError(f"robot {agent} is not in the scenario, expected one of {self.agents}")

    def motions(self, agent: int) -> int:
        """|E_ik|: transitions that robot `agent` makes in a round."""
        return self._per_round[agent][0]

    def batches(self, agent: int) -> int:
        """B_ik: gradient steps of robot `agent` in a round."""
        return self._per_round[agent][1]

    @cached_property
    def _per_round(self) -> dict[int, tuple[int, int]]:
        """Robot -> motions and batches of its round: its own, else its task's, else those of all."""
        own, per_round = {robot.id: robot for robot in self.robots}, {}
        for task in self.tasks:
            for agent in self.clusters[task.id]:
                sections = (*((own[agent],) if agent in own else ()), task, self.learning)
                motions = next(each.motions_per_round for each in sections if each.motions_per_round is not None)
                batches = next(each.batches_per_round for each in sections if each.batches_per_round is not None)
                per_round[agent] = motions, batches
        return per_round

    @property
    def agents(self) -> tuple[int, ...]:
        """Ids of all robots."""
        return tuple(agent for cluster in self.clusters.values() for agent in cluster)

    @property
    def training_agents(self) -> dict[int, tuple[int, ...]]:
        """Training task id -> ids of the robots that send its experience up; without a stage there may be none."""
        tasks = (task for task in self.meta.training_tasks if task in self.clusters)
        return {task: self.cluster(task)[: self.meta.robots_per_task] for task in tasks}

    @property
    def meta_epsilon(self) -> float:
        """Share of random actions in the experience for the data center: that of all robots, unless it has its own."""
        return self.learning.epsilon if self.meta.epsilon is None else self.meta.epsilon

    @property
    def meta_starts(self) -> Starts:
        """Where its episodes start: as those of all robots, unless it has its own."""
        return self.learning.starts if self.meta.starts is None else self.meta.starts
