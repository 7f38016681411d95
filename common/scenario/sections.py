"""The sections of a scenario file, every field with its default, bounds and meaning."""

from __future__ import annotations

import sys
from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, field_validator

from jouleswarm.codecs.codec import CodecName, ExperienceCodec, WeightsCodec

# Every number has both bounds: far beyond what anybody runs, and within what arithmetic, memory and messages can hold.
Id = Annotated[int, Field(ge=1, le=1_000_000)]
Robots = Annotated[int, Field(ge=1, le=1000)]
Landmarks = Annotated[int, Field(ge=1, le=64)]
Rounds = Annotated[int, Field(ge=1, le=1_000_000)]
Batches = Annotated[int, Field(ge=1, le=100_000)]  # gradient steps of a round
BatchSize = Annotated[int, Field(ge=1, le=100_000)]
Motions = Annotated[int, Field(ge=1, le=100_000)]
Frames = Annotated[int, Field(ge=3, le=100_000_000)]  # fewer can all be without a successor: nothing to learn from
CameraPixels = Annotated[int, Field(ge=1, le=4096)]
NetworkPixels = Annotated[int, Field(ge=1, le=1024)]
Channels = Annotated[int, Field(ge=1, le=4096)]
Kernel = Annotated[int, Field(ge=1, le=1024)]
Units = Annotated[int, Field(ge=1, le=1_000_000)]

Fraction = Annotated[float, Field(ge=0, le=1)]
Share = Annotated[float, Field(ge=1e-9, le=1)]
Metres = Annotated[float, Field(ge=1e-3, le=1e4)]
Seconds = Annotated[float, Field(ge=1e-3, le=1e6)]
RewardSetting = Annotated[float, Field(ge=-1e6, le=1e6)]  # see common.wire.messages.MAX_REWARD
LearningRate = Annotated[float, Field(ge=1e-37, le=1e3)]  # float32 holds it
Watts = Annotated[float, Field(ge=1e-6, le=1e9)]
BatchSeconds = Annotated[float, Field(ge=1e-9, le=1e6)]
Efficiency = Annotated[float, Field(ge=1e-6, le=1e15)]  # bit/J
Pue = Annotated[float, Field(ge=1, le=1e3)]
BetaFactor = Annotated[float, Field(ge=1, le=1e6)]
CarbonIntensity = Annotated[float, Field(ge=0, le=1e6)]  # gCO2e a kWh

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


class World(Section):
    """The landmark grid and how a map becomes a position-reward table."""

    rows: Landmarks = 8
    cols: Landmarks = 5
    cell_m: Metres = Field(1.0, description="distance between landmarks, metres")
    exit_reward: RewardSetting = 80.0
    path_reward: RewardSetting = Field(-0.5, description="reward on the path next to the exit")
    path_slope: float = Field(2.5, ge=0, le=1e6, description="how much lower the reward is at the path's beginning")
    off_path_reward: RewardSetting = Field(
        -1.5, description="added for each motion away from the nearest path landmark"
    )
    obstacle_reward: RewardSetting = -80.0
    max_motions: int = Field(20, ge=1, le=100_000, description="an episode is truncated after this many motions")


class Task(Section):
    """One trajectory to follow, drawn as a text map (see landmarks/maps.py)."""

    id: Id
    map: str
    rewards: tuple[RewardSetting, ...] | None = Field(
        None, description="position-reward table, row by row, in place of the one made from the map"
    )
    robots: Robots | None = Field(None, description="cluster size; default federation.robots_per_cluster")


class Camera(Section):
    """The robots' two cameras: RGB and time of flight (5 m range), one frame = (height, width, 4) uint8."""

    width: CameraPixels = 640
    height: CameraPixels = 480
    range_m: Metres = 5.0
    pose_jitter_m: float = Field(0.03, ge=0, le=1e4)
    heading_jitter_deg: float = Field(2.0, ge=0, lt=45)
    noise: float = Field(4.0, ge=0, le=255, description="standard deviation of the sensor noise, grey levels")


class Network(Section):
    """The Q-network of Mnih et al. (2015): convolutions, one or more dense layers, one output an action."""

    width: NetworkPixels = 96
    height: NetworkPixels = 72
    conv: tuple[tuple[Channels, Kernel, Kernel], ...] = Field(
        ((32, 8, 4), (64, 4, 2), (64, 3, 1)), max_length=32, description="(channels, kernel, stride) of each layer"
    )
    dense: tuple[Units, ...] = Field((512,), max_length=32)


Starts = Literal["area", "anywhere", "entry"]


class Learning(Section):
    """Deep Q-learning, eq. (7), on a robot."""

    discount: Fraction = Field(0.99, description="nu")
    double: bool = Field(True, description="double learning: argmax by the online network")
    optimizer: Literal["adam", "sgd"] = "adam"
    lr: LearningRate = 1e-3
    adam_eps: float = Field(1e-4, ge=1e-37, le=1e3, description="Adam's epsilon: damps steps where gradients are small")
    grad_clip: float = Field(1.0, ge=1e-6, le=1e9)
    batch_size: BatchSize = 32
    batches_per_round: Batches = Field(20, description="B_i")
    motions_per_round: Motions = Field(20, description="|E_ik|, new transitions a round")
    epsilon: Fraction = 0.1
    replay_size: Frames = 2000
    target_polyak: Share = Field(0.03, description="target += this * (online - target) ...")
    target_every: int = Field(1, ge=1, le=1_000_000_000, description="... every so many gradient steps")
    starts: Starts = Field(
        "area", description="where learning episodes start: the robot's own share of the landmarks, any, the entry"
    )


class Federation(Section):
    """Decentralized federated averaging inside a cluster, eq. (6)."""

    robots_per_cluster: Robots = 2
    topology: Literal["full", "ring", "random"] = "full"
    degree: Robots = Field(2, description="neighbours of each robot under the random topology")
    step: float | None = Field(
        None,
        ge=1e-9,
        le=1,
        description="consensus step; 1 = literal eq. (6); default 1/(N+1), and topk_share/(N+1) with codec topk: most "
        "of what robots then hold of each other is old, and at larger steps they go past each other by ever more",
    )
    codec: CodecName = Field(
        "float32",
        description="of weights on every link, meta-models included: float32, float16 (values beyond 65504 clipped), "
        "int8 (a float32 scale a tensor) or topk (the entries that changed most, 8 bytes each; first messages whole)",
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
    max_rounds: Rounds = 200
    target_reward: float = Field(50.0, ge=-1e9, le=1e9)
    reward_window: int = Field(5, ge=1, le=1_000_000, description="R is the mean over this many rounds")

    @property
    def weights_codec(self) -> WeightsCodec:
        """How weights are written."""
        return WeightsCodec(self.codec, self.topk_share)


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
    support_batches: Batches = Field(10, description="B^(a): batches of the inner loop a task and round")
    query_batches: Batches = Field(10, description="B^(b): batches of the meta-updates a task and round")
    inner_steps: Batches = Field(
        1, description="SGD steps, one support batch each, before a meta-update: B^(a) / this meta-updates a round"
    )
    support_newest: Frames = Field(5000, description="support batches are drawn from so many newest motions")
    batch_size: BatchSize = 32
    inner_lr: LearningRate = Field(0.03, description="mu; gradients are clipped to learning.grad_clip before")
    meta_lr: LearningRate = Field(1e-3, description="eta, of Adam")
    target_polyak: Share = Field(0.1, description="per-task target network tracking, each meta-update")
    epsilon: Fraction = Field(0.6, description="of the policy that collects: table-greedy with random motions")
    starts: Starts = Field("anywhere", description="where its episodes start: see learning.starts")
    replay_size: Frames = 5000
    experience_codec: ExperienceCodec = Field(
        "raw",
        description="frames on the uplink, of centralized learning too: raw, png (lossless, payloads vary in size) or "
        "resized (to the network's input, as the data center would do); what is learned is the same to the bit",
    )

    _each_once = field_validator("training_tasks", "snapshots", "adapt_from")(each_once)


class Energy(Section):
    """Price lists, and the constants of the energy model (Table I). kb = 1000 bit."""

    prices: tuple[str, ...] = Field(
        ("literal", "published"),
        min_length=1,
        max_length=20,
        description="price lists: literal (the equations), published (what the printed totals come to a round), or "
        "module:Class, a list of one's own (see docs/doors.md)",
    )
    p0_w: Watts = Field(590.0, description="P_0, data center power")
    t0_batch_s: BatchSeconds = Field(0.020, description="T_0, data center time of one batch gradient")
    pk_w: Watts = Field(5.1, description="P_k, robot power")
    tk_batch_s: BatchSeconds = Field(0.400, description="T_k, robot time of one batch gradient")
    pue: Pue = Field(1.67, description="gamma")
    beta: BetaFactor | Literal["measured"] = Field(
        1.0, description="cost of an exact meta-gradient over a first-order one, or: measured by the data center"
    )
    ul_bit_per_j: Efficiency = 200e3
    sl_bit_per_j: Efficiency = 500e3
    dl_bit_per_j: Efficiency | None = Field(None, description="default: as uplink (the paper gives none)")
    sidelink: Literal["direct", "via_base_station"] = "direct"
    datacenter_g_per_kwh: CarbonIntensity | None = Field(None, description="gCO2e a kWh where the data center is")
    robots_g_per_kwh: CarbonIntensity | None = Field(None, description="gCO2e a kWh where the robots are charged")

    _each_once = field_validator("prices")(each_once)


class Bus(Section):
    """How messages travel."""

    qos: Literal[0, 1] = Field(1, description="of experience, weights and meta-model; control is always 1")
    keepalive_s: int = Field(60, ge=60, le=65535, description="as long as MQTT can say")
    resend_after_s: Seconds = Field(10.0, description="ask again for what has not come after this long")
    connect_timeout_s: Seconds = Field(30.0, description="give up on a broker that does not answer")
