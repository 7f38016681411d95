"""What is priced and what it comes to: counts of a stage, its cost by cause and site, the bill of an arm. No prices."""

from __future__ import annotations

from dataclasses import astuple, dataclass, field


@dataclass(frozen=True)
class Counts:
    """What was done: batch gradients computed and bytes moved. Counts of separate stages or tasks add up."""

    gradients_support: float = 0  # in the data center, on B^(a), and all others of first order
    gradients_query: float = 0  # in the data center, on B^(b)
    gradients_robots: float = 0
    uplink_bytes: float = 0  # delivered to the data center
    downlink_bytes: float = 0  # delivered to robots
    sidelink_bytes: float = 0  # delivered to neighbours, summed over directed links
    sidelink_sent_bytes: float = 0  # sent by robots, each message once however many neighbours it has

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))


@dataclass(frozen=True)
class StageCounts:
    """The counts of an arm by stage: meta-learning, eqs. (8)-(9), and what its tasks took, eqs. (10)-(11)."""

    ml: Counts = field(default_factory=Counts)
    fl: Counts = field(default_factory=Counts)

    def __add__(self, other: StageCounts) -> StageCounts:
        return StageCounts(self.ml + other.ml, self.fl + other.fl)


@dataclass(frozen=True)
class Cost:
    """Joules by cause; each cause is paid at one site. Costs add up."""

    center_computing_j: float = 0.0
    robot_computing_j: float = 0.0
    uplink_j: float = 0.0
    downlink_j: float = 0.0
    sidelink_robots_j: float = 0.0  # direct sidelinks, or the way up to the base station
    sidelink_center_j: float = 0.0  # the way down from the base station, gamma included; 0 for direct sidelinks

    def __add__(self, other: Cost) -> Cost:
        return Cost(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    @property
    def sidelink_j(self) -> float:
        """Sidelinks, whoever pays."""
        return self.sidelink_robots_j + self.sidelink_center_j

    @property
    def learning_j(self) -> float:
        """Computing at both sites."""
        return self.center_computing_j + self.robot_computing_j

    @property
    def communication_j(self) -> float:
        """All links."""
        return self.uplink_j + self.downlink_j + self.sidelink_j

    @property
    def robots_j(self) -> float:
        """Paid by the robots: their computing and what they send."""
        return self.robot_computing_j + self.uplink_j + self.sidelink_robots_j

    @property
    def datacenter_j(self) -> float:
        """Paid by the data center and its base station: its computing and what is sent down."""
        return self.center_computing_j + self.downlink_j + self.sidelink_center_j

    @property
    def total_j(self) -> float:
        """Everything."""
        return self.learning_j + self.communication_j


@dataclass(frozen=True)
class Bill:
    """The costs of an arm by stage, eq. (12). Bills add up."""

    ml: Cost = field(default_factory=Cost)  # meta-learning, eq. (8)
    fl: Cost = field(default_factory=Cost)  # what the tasks took, eq. (10)

    def __add__(self, other: Bill) -> Bill:
        return Bill(self.ml + other.ml, self.fl + other.fl)

    @property
    def both(self) -> Cost:
        """Both stages by cause."""
        return self.ml + self.fl

    @property
    def ml_learning_j(self) -> float:
        """Computing of the meta-learning stage."""
        return self.ml.learning_j

    @property
    def ml_communication_j(self) -> float:
        """Traffic of the meta-learning stage."""
        return self.ml.communication_j

    @property
    def ml_j(self) -> float:
        """E_ML, eq. (8)."""
        return self.ml.total_j

    @property
    def fl_learning_j(self) -> float:
        """Computing of the tasks' stage."""
        return self.fl.learning_j

    @property
    def fl_communication_j(self) -> float:
        """Traffic of the tasks' stage."""
        return self.fl.communication_j

    @property
    def fl_j(self) -> float:
        """Sum of E_FL over the tasks, eq. (10)."""
        return self.fl.total_j

    @property
    def robots_j(self) -> float:
        """Paid by the robots."""
        return self.ml.robots_j + self.fl.robots_j

    @property
    def datacenter_j(self) -> float:
        """Paid by the data center."""
        return self.ml.datacenter_j + self.fl.datacenter_j

    @property
    def total_j(self) -> float:
        """E, eq. (12)."""
        return self.ml_j + self.fl_j


@dataclass(frozen=True)
class PublishedBill:
    """Joules by stage; the paper's printed totals tell neither learning from communication nor site from site."""

    ml_j: float
    fl_j: float

    @property
    def total_j(self) -> float:
        """E, eq. (12)."""
        return self.ml_j + self.fl_j
