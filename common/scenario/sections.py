"""The sections of a scenario file, every field with its default, bounds and meaning."""

from __future__ import annotations

import sys
from typing import Any, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from jouleswarm.common.scenario.bounds import (
    TOPOLOGIES,
    Batches,
    BatchSize,
    Channels,
    Fraction,
    Frames,
    Id,
    Kernel,
    LearningRate,
    Motions,
    NetworkPixels,
    Robots,
    Rounds,
    Seconds,
    Share,
    Units,
)

Value = TypeVar("Value")


class Section(BaseModel):
    """Unknown fields are refused, and numbers that are not finite or subnormal; nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _is_normal(cls, value: Value) -> Value:
        if isinstance(value, float) and 0 < abs(value) < sys.float_info.min:
            raise ValueError(f"{value:g} is subnormal; expected 0 or a size of {sys.float_info.min:g} or more")
        return value


def each_once(values: tuple[Value, ...]) -> tuple[Value, ...]:
    """`values`, if no two are alike."""
    if len(set(values)) != len(values):
        raise ValueError(f"got {list(values)}, expected each once")
    return values


class Task(Section):  # type: ignore[no-redef]  # of its __init__, which takes any other field as well
    """One task: what its environment is made with. An environment may have fields of its own beside these."""

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    id: Id = Field(description="its number, in topics and tables")
    robots: Robots | None = Field(None, description="cluster size; default federation.robots_per_cluster")
    motions_per_round: Motions | None = Field(None, description="of its robots; default learning.motions_per_round")
    batches_per_round: Batches | None = Field(None, description="of its robots; default learning.batches_per_round")
    kwargs: dict[str, Any] = Field({}, description="arguments of the environment's factory")


class Network(Section):
    """The Q-network: by default that of Mnih et al. (2015) for images, dense layers alone for all else."""

    build: str | None = Field(
        None, description="deepmind, mlp or module:build; default by the observation: images deepmind, else mlp"
    )
    kwargs: dict[str, Any] = Field({}, description="for a network of your own")
    width: NetworkPixels | None = Field(None, description="images are shrunk to this; default as they are")
    height: NetworkPixels | None = Field(None, description="the same")
    conv: tuple[tuple[Channels, Kernel, Kernel], ...] = Field(
        ((32, 8, 4), (64, 4, 2), (64, 3, 1)), max_length=32, description="(channels, kernel, stride) of each layer"
    )
    dense: tuple[Units, ...] = Field((512,), max_length=32, description="units of each dense layer but the last")


Starts = Literal["area", "anywhere", "entry"]


class Learning(Section):
    """Deep Q-learning, eq. (7), on a robot."""

    discount: Fraction = Field(0.99, description="nu")
    double: bool = Field(True, description="double learning: argmax by the online network")
    optimizer: Literal["adam", "sgd"] = Field("adam", description="of the robots' gradient steps")
    lr: LearningRate = Field(1e-3, description="its step size")
    adam_eps: float = Field(1e-4, ge=1e-37, le=1e3, description="Adam's epsilon: damps steps where gradients are small")
    grad_clip: float = Field(1.0, ge=1e-6, le=1e9, description="gradients longer than this are shortened to it")
    batch_size: BatchSize = Field(32, description="transitions of a batch gradient")
    batches_per_round: Batches = Field(20, description="B_i")
    motions_per_round: Motions = Field(20, description="|E_ik|, new transitions a round")
    collect: Literal["guide", "own"] = Field(
        "guide",
        description="whom robots follow while they collect, but for random actions. guide: the environment's known "
        "good policy, whatever they are learning, as robots do whose experience the data center learns from; in an "
        "environment without a guide as own. own: the newest of the models that are being learned",
    )
    epsilon: Fraction = Field(0.3, description="share of random actions while robots collect; the paper has 0.1")
    replay_size: Frames = Field(2000, description="observations that a robot remembers")
    target_polyak: Share = Field(0.03, description="target += this * (online - target) ...")
    target_every: int = Field(1, ge=1, le=1_000_000_000, description="... every so many gradient steps")
    init: str | None = Field(
        None,
        min_length=1,
        max_length=1000,
        description="a model to begin from in place of random weights, beside the scenario: a file of a run's weights/ "
        "(.safetensors). Of robots without a stage before, of the stage itself, and of central learners",
    )
    starts: Starts = Field(
        "anywhere",
        description="where learning episodes start, of an environment that offers it: in the robot's own share of the "
        "places, anywhere, or where an evaluation starts",
    )
    max_episode_steps: int = Field(
        1000, ge=1, le=10_000_000, description="an episode that its environment has not ended is cut after so many"
    )


class Federation(Section):
    """Decentralized federated averaging inside a cluster, eq. (6)."""

    robots_per_cluster: Robots = Field(2, description="robots that learn a task together")
    topology: str = Field("full", description="full, ring, random, or a file of the graph's edges: NAME.csv")
    degree: Robots = Field(2, description="neighbours of each robot under the random topology")
    step: float | None = Field(
        None,
        ge=1e-9,
        le=1,
        description="consensus step; 1 = literal eq. (6); default 1/(N+1), and topk_share/(N+1) with codec topk: most "
        "of what robots then hold of each other is old, and at larger steps they go past each other by ever more",
    )
    codec: str = Field(
        "float32",
        min_length=1,
        max_length=200,
        description="of weights on every link, meta-models included: float32, float16 (values beyond 65504 clipped), "
        "int8 (a float32 scale a tensor), topk (the entries that changed most, 8 bytes each; first messages whole) or "
        "module:Class (see docs/doors.md)",
    )
    topk_share: Share = Field(0.05, description="share of the entries in a topk message, over all tensors")
    on_missing: Literal["wait", "proceed"] = Field(
        "wait",
        description="when a neighbour is gone: wait for it (the same result whatever happens), or go on without it",
    )
    missing_after_s: Seconds = Field(
        30.0, description="with on_missing proceed: a neighbour that is not heard of for this long is left out"
    )
    give_up_after_s: float = Field(
        600.0,
        ge=0,
        le=1e9,
        description="a wait ends the run, by name, when who is waited for has not answered for so long or has itself "
        "waited so long for nothing; 0: never. Longer than the longest round takes on the slowest machine",
    )
    max_rounds: Rounds = Field(200, description="an arm that has not learned a task by then ends")
    target_reward: float = Field(50.0, ge=-1e9, le=1e9, description="R at which a task is learned")
    reward_window: int = Field(5, ge=1, le=1_000_000, description="R is the mean over this many rounds")
    window: Literal["full", "partial"] = Field(
        "full",
        description="full: a task is learned in round 0, by as many episodes of the model that it starts from, or not "
        "before R's window is full; partial: in earlier rounds too, by a mean over those that there are",
    )

    @field_validator("topology")
    @classmethod
    def _is_a_rule_or_a_file(cls, topology: str) -> str:
        if topology not in TOPOLOGIES and not topology.endswith(".csv"):
            raise ValueError(f"got {topology!r:.60}, expected {', '.join(TOPOLOGIES)}, or a file of edges, NAME.csv")
        return topology

    @property
    def has_own_edges(self) -> bool:
        """Whether the graph is the user's own."""
        return self.topology not in TOPOLOGIES


class Meta(Section):
    """MAML in the data center, eqs. (3)-(5)."""

    t0: int = Field(42, ge=0, le=1_000_000, description="MAML rounds before the meta-model goes down")
    snapshots: tuple[Rounds, ...] = Field((), description="rounds whose meta-model is kept as well")
    adapt_from: tuple[Rounds, ...] = Field(
        (), max_length=1000, description="rounds whose meta-model the robots adapt as well, each an arm of its own"
    )
    training_tasks: tuple[Id, ...] = Field((1, 2, 6), description="the Q training tasks")
    robots_per_task: Robots = Field(1, description="robots of each training cluster that send experience")
    heads: Literal["per_task", "shared"] = Field(
        "per_task", description="a last layer for each training task (others start from their mean), or one for all"
    )
    rehearse_unseen: bool = Field(
        False,
        description="with heads per_task: every second meta-update takes each training task as if it were unseen, from "
        "the mean of the other tasks' heads",
    )
    support_batches: Batches = Field(10, description="B^(a): batches of the inner loop a task and round")
    query_batches: Batches = Field(10, description="B^(b): batches of the meta-updates a task and round")
    inner_steps: Batches = Field(
        1, description="SGD steps, one support batch each, before a meta-update: B^(a) / this meta-updates a round"
    )
    support_newest: Frames = Field(5000, description="support batches are drawn from so many newest motions")
    batch_size: BatchSize = Field(32, description="transitions of a batch gradient")
    inner_lr: LearningRate = Field(0.03, description="mu; gradients are clipped to learning.grad_clip before")
    inner_lr_step: float = Field(
        0.0,
        ge=0,
        le=1e3,
        description="step size of Adam on log mu: above 0 maml, fomaml and anil learn mu of each layer from inner_lr "
        "on (Meta-SGD), in the data center alone; 0: it stays inner_lr",
    )
    meta_lr: LearningRate = Field(1e-3, description="eta, of Adam")
    target_polyak: Share = Field(0.1, description="per-task target network tracking, each meta-update")
    epsilon: Fraction | None = Field(
        None,
        description="share of random actions in its experience, else by the environment's guide (without one all are "
        "random); default learning.epsilon",
    )
    starts: Starts | None = Field(None, description="where its episodes start; default learning.starts")
    replay_size: Frames = Field(5000, description="observations that the data center remembers of each training robot")
    experience_codec: str = Field(
        "raw",
        min_length=1,
        max_length=200,
        description="of observations on the uplink, of centralized learning too: raw, png (lossless, payloads vary in "
        "size) or resized (to the network's input, as the data center would do), with which the same is learned to the "
        "bit; or module:Class (see docs/doors.md)",
    )

    _each_once = field_validator("training_tasks", "snapshots", "adapt_from")(each_once)

    @model_validator(mode="after")
    def _has_other_heads(self) -> Self:
        if self.rehearse_unseen and (self.heads == "shared" or len(self.training_tasks) < 2):
            raise ValueError(
                f"rehearse_unseen with heads {self.heads} and training_tasks {list(self.training_tasks)}: there is no "
                'mean of other heads; expected heads = "per_task" and two training tasks or more'
            )
        return self


class Bus(Section):
    """How messages travel."""

    qos: Literal[0, 1] = Field(1, description="of experience, weights and meta-model; control is always 1")
    keepalive_s: int = Field(60, ge=60, le=65535, description="as long as MQTT can say")
    resend_after_s: Seconds = Field(10.0, description="ask again for what has not come after this long")
    connect_timeout_s: Seconds = Field(30.0, description="give up on a broker that does not answer")
