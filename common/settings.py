"""The sections of a scenario file, every field with its default, bounds and meaning."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from common.codecs import CodecName, ExperienceCodec, WeightsCodec

Positive = Annotated[int, Field(ge=1)]
Fraction = Annotated[float, Field(ge=0, le=1)]
RewardSetting = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]  # see common.payloads.MAX_REWARD
PositiveFloat = Annotated[float, Field(gt=0)]
CarbonIntensity = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Section(BaseModel):
    """Unknown fields are refused; nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class World(Section):
    """The landmark grid and how a map becomes a position-reward table."""

    rows: Positive = 8
    cols: Positive = 5
    cell_m: PositiveFloat = Field(1.0, description="distance between landmarks, metres")
    exit_reward: RewardSetting = 80.0
    path_reward: RewardSetting = Field(-0.5, description="reward on the path next to the exit")
    path_slope: float = Field(2.5, ge=0, le=1e6, description="how much lower the reward is at the path's beginning")
    off_path_reward: RewardSetting = Field(
        -1.5, description="added for each motion away from the nearest path landmark"
    )
    obstacle_reward: RewardSetting = -80.0
    max_motions: Positive = Field(20, description="an episode is truncated after this many motions")


class Task(Section):
    """One trajectory to follow, drawn as a text map (see common/maps.py)."""

    id: Positive
    map: str
    rewards: tuple[RewardSetting, ...] | None = Field(
        None, description="position-reward table, row by row, in place of the one made from the map"
    )
    robots: int | None = Field(None, ge=1, description="cluster size; default federation.robots_per_cluster")


class Camera(Section):
    """The robots' two cameras: RGB and time of flight (5 m range), one frame = (height, width, 4) uint8."""

    width: Positive = 640
    height: Positive = 480
    range_m: PositiveFloat = 5.0
    pose_jitter_m: float = Field(0.03, ge=0)
    heading_jitter_deg: float = Field(2.0, ge=0, lt=45)
    noise: float = Field(4.0, ge=0, description="standard deviation of the sensor noise, grey levels")


class Network(Section):
    """The Q-network of Mnih et al. (2015): convolutions, one or more dense layers, one output an action."""

    width: Positive = 96
    height: Positive = 72
    conv: tuple[tuple[Positive, Positive, Positive], ...] = Field(
        ((32, 8, 4), (64, 4, 2), (64, 3, 1)), description="(channels, kernel, stride) of each layer"
    )
    dense: tuple[Positive, ...] = (512,)


Starts = Literal["area", "anywhere", "entry"]


class Learning(Section):
    """Deep Q-learning, eq. (7), on a robot."""

    discount: Fraction = Field(0.99, description="nu")
    double: bool = Field(True, description="double learning: argmax by the online network")
    optimizer: Literal["adam", "sgd"] = "adam"
    lr: PositiveFloat = 1e-3
    adam_eps: PositiveFloat = Field(1e-4, description="Adam's epsilon: damps steps where gradients are small")
    grad_clip: PositiveFloat = 1.0
    batch_size: Positive = 32
    batches_per_round: Positive = Field(20, description="B_i")
    motions_per_round: Positive = Field(20, description="|E_ik|, new transitions a round")
    epsilon: Fraction = 0.1
    replay_size: Positive = 2000
    target_polyak: float = Field(0.03, gt=0, le=1, description="target += this * (online - target) ...")
    target_every: Positive = Field(1, description="... every so many gradient steps")
    starts: Starts = Field(
        "area", description="where learning episodes start: the robot's own share of the landmarks, any, the entry"
    )


class Federation(Section):
    """Decentralized federated averaging inside a cluster, eq. (6)."""

    robots_per_cluster: Positive = 2
    topology: Literal["full", "ring", "random"] = "full"
    degree: Positive = Field(2, description="neighbours of each robot under the random topology")
    step: float | None = Field(
        None,
        gt=0,
        le=1,
        description="consensus step; 1 = literal eq. (6); default 1/(N+1), and topk_share/(N+1) with codec topk: most "
        "of what robots then hold of each other is old, and at larger steps they go past each other by ever more",
    )
    codec: CodecName = Field(
        "float32",
        description="of weights on every link, meta-models included: float32, float16 (values beyond 65504 clipped), "
        "int8 (a float32 scale a tensor) or topk (the entries that changed most, 8 bytes each; first messages whole)",
    )
    topk_share: float = Field(0.05, gt=0, le=1, description="share of the entries in a topk message, over all tensors")
    on_missing: Literal["wait", "proceed"] = Field(
        "wait",
        description="when a neighbour is gone: wait for it (the same result whatever happens), or go on without it",
    )
    missing_after_s: PositiveFloat = Field(
        30.0, description="with on_missing proceed: a neighbour that is not heard of for this long is left out"
    )
    give_up_after_s: float = Field(
        600.0,
        ge=0,
        allow_inf_nan=False,
        description="a wait ends the run, by name, when who is waited for has not answered for so long or has itself "
        "waited so long for nothing; 0: never. Longer than the longest round takes on the slowest machine",
    )
    max_rounds: Positive = 200
    target_reward: float = 50.0
    reward_window: Positive = Field(5, description="R is the mean over this many rounds")

    @property
    def weights_codec(self) -> WeightsCodec:
        """How weights are written."""
        return WeightsCodec(self.codec, self.topk_share)


class Meta(Section):
    """MAML in the data center, eqs. (3)-(5)."""

    t0: int = Field(42, ge=0, description="MAML rounds before the meta-model goes down")
    snapshots: tuple[Positive, ...] = Field((), description="rounds whose meta-model is kept as well")
    adapt_from: tuple[Positive, ...] = Field(
        (), description="rounds whose meta-model the robots adapt as well, each an arm of its own"
    )
    training_tasks: tuple[Positive, ...] = Field((1, 2, 6), description="the Q training tasks")
    robots_per_task: Positive = Field(1, description="robots of each training cluster that send experience")
    heads: Literal["per_task", "shared"] = Field(
        "per_task", description="a last layer for each training task (others start from their mean), or one for all"
    )
    support_batches: Positive = Field(10, description="B^(a): batches of the inner loop a task and round")
    query_batches: Positive = Field(10, description="B^(b): batches of the meta-updates a task and round")
    inner_steps: Positive = Field(
        1, description="SGD steps, one support batch each, before a meta-update: B^(a) / this meta-updates a round"
    )
    support_newest: Positive = Field(5000, description="support batches are drawn from so many newest motions")
    batch_size: Positive = 32
    inner_lr: PositiveFloat = Field(0.03, description="mu; gradients are clipped to learning.grad_clip before")
    meta_lr: PositiveFloat = Field(1e-3, description="eta, of Adam")
    target_polyak: float = Field(0.1, gt=0, le=1, description="per-task target network tracking, each meta-update")
    epsilon: Fraction = Field(0.6, description="of the policy that collects: table-greedy with random motions")
    starts: Starts = Field("anywhere", description="where its episodes start: see learning.starts")
    replay_size: Positive = 5000
    experience_codec: ExperienceCodec = Field(
        "raw",
        description="frames on the uplink, of centralized learning too: raw, png (lossless, payloads vary in size) or "
        "resized (to the network's input, as the data center would do); what is learned is the same to the bit",
    )


class Energy(Section):
    """Constants of the energy model (Table I). kb = 1000 bit."""

    p0_w: PositiveFloat = Field(590.0, description="P_0, data center power")
    t0_batch_s: PositiveFloat = Field(0.020, description="T_0, data center time of one batch gradient")
    pk_w: PositiveFloat = Field(5.1, description="P_k, robot power")
    tk_batch_s: PositiveFloat = Field(0.400, description="T_k, robot time of one batch gradient")
    pue: float = Field(1.67, ge=1, description="gamma")
    beta: Annotated[float, Field(ge=1)] | Literal["measured"] = Field(
        1.0, description="cost of an exact meta-gradient over a first-order one, or: measured by the data center"
    )
    ul_bit_per_j: PositiveFloat = 200e3
    sl_bit_per_j: PositiveFloat = 500e3
    dl_bit_per_j: PositiveFloat | None = Field(None, description="default: as uplink (the paper gives none)")
    sidelink: Literal["direct", "via_base_station"] = "direct"
    datacenter_g_per_kwh: CarbonIntensity | None = Field(None, description="gCO2e a kWh where the data center is")
    robots_g_per_kwh: CarbonIntensity | None = Field(None, description="gCO2e a kWh where the robots are charged")


class Bus(Section):
    """How messages travel."""

    qos: Literal[0, 1] = Field(1, description="of experience, weights and meta-model; control is always 1")
    keepalive_s: int = Field(60, ge=60)
    resend_after_s: PositiveFloat = Field(10.0, description="ask again for what has not come after this long")
    connect_timeout_s: PositiveFloat = Field(30.0, description="give up on a broker that does not answer")
