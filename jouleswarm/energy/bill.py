"""What facts come to: joules of an arm by phase, cause and site. No prices."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from operator import add
from typing import NamedTuple

Joules = float | None
"""None: not known, or not told by the price list; that is not nothing."""


class Cause(NamedTuple):
    """What joules were spent on, as tables name it."""

    key: str
    """In summary.json."""
    label: str
    column: str
    """In a study's CSV tables."""
    heading: str
    """In a study's tables for readers."""


CAUSES = (
    Cause("computing_datacenter", "computing, data center", "center_j", "data center"),
    Cause("computing_robots", "computing, robots", "robots_j", "robots"),
    Cause("uplink", "uplink", "uplink_j", "uplink"),
    Cause("downlink", "downlink", "downlink_j", "downlink"),
    Cause("sidelink", "sidelinks", "sidelink_j", "sidelink"),
    Cause("acting", "acting", "acting_j", "acting"),
    Cause("evaluating", "evaluating", "evaluating_j", "evaluating"),
    Cause("waiting", "waiting", "waiting_j", "waiting"),
    Cause("other", "other", "other_j", "other"),
)
PAPER_CAUSES = CAUSES[:5]
"""What the paper's model knows. The last cause is what none of the others is; tables have those that the paper does not
know only where there are joules of them."""
SITES = {"datacenter": "data center", "robots": "robots"}
PARTS = {
    "ml_learning": "meta-learning: computing",
    "ml_communication": "meta-learning: traffic",
    "ml": "E_ML, eq. (8)",
    "fl_learning": "tasks: computing",
    "fl_communication": "tasks: traffic",
    "fl": "E_FL, eq. (10)",
    "total": "E, eq. (12)",
}


@dataclass(frozen=True)
class Cost:
    """Joules by cause; each cause is paid at one site. Costs add up."""

    computing_datacenter_j: float = 0.0
    computing_robots_j: float = 0.0
    uplink_j: float = 0.0  # paid by robots
    uplink_datacenter_j: float = 0.0  # by the base station that receives it
    downlink_j: float = 0.0  # paid by the data center
    downlink_robots_j: float = 0.0  # by robots that receive it or pass it on
    sidelink_robots_j: float = 0.0  # direct sidelinks, or the way up to the base station
    sidelink_datacenter_j: float = 0.0  # the way down from the base station, gamma included; 0 for direct sidelinks
    acting_robots_j: float = 0.0  # motions to learn from
    evaluating_robots_j: float = 0.0  # motions and forward passes of greedy episodes
    waiting_robots_j: float = 0.0
    waiting_datacenter_j: float = 0.0
    other_datacenter_j: float = 0.0
    other_robots_j: float = 0.0
    untold_j: float = 0.0  # the list says neither what for nor who pays

    def __add__(self, other: Cost) -> Cost:
        return Cost(*map(add, vars(self).values(), vars(other).values()))  # `astuple` copies, ten times as slow

    @property
    def sidelink_j(self) -> float:
        """Sidelinks, whoever pays."""
        return self.sidelink_robots_j + self.sidelink_datacenter_j

    @property
    def other_j(self) -> float:
        """What no cause has a name for, whoever pays."""
        return self.other_datacenter_j + self.other_robots_j

    @property
    def waiting_j(self) -> float:
        """Waiting at both sites."""
        return self.waiting_robots_j + self.waiting_datacenter_j

    @property
    def unknown_to_paper_j(self) -> float:
        """What the paper's model leaves out."""
        return self.acting_robots_j + self.evaluating_robots_j + self.waiting_j + self.other_j

    @property
    def learning_j(self) -> float:
        """Computing at both sites."""
        return self.computing_datacenter_j + self.computing_robots_j

    @property
    def communication_j(self) -> float:
        """All links."""
        told = self.uplink_j + self.downlink_j + self.sidelink_j + self.downlink_robots_j
        return told + self.uplink_datacenter_j

    @property
    def robots_j(self) -> float:
        """Paid by the robots: their computing, what they send, and what else is theirs."""
        paper = self.computing_robots_j + self.uplink_j + self.sidelink_robots_j
        body = self.acting_robots_j + self.evaluating_robots_j + self.waiting_robots_j
        return paper + body + self.downlink_robots_j + self.other_robots_j

    @property
    def datacenter_j(self) -> float:
        """Paid by the data center and its base station: its computing, what is sent down, and what else is theirs."""
        paper = self.computing_datacenter_j + self.downlink_j + self.sidelink_datacenter_j
        return paper + self.uplink_datacenter_j + self.waiting_datacenter_j + self.other_datacenter_j

    @property
    def total_j(self) -> float:
        """Everything."""
        return self.learning_j + self.communication_j + self.unknown_to_paper_j + self.untold_j

    @property
    def by_cause(self) -> dict[Cause, float]:
        """Joules of each cause; with what is not told they are the total."""
        computing = self.computing_datacenter_j, self.computing_robots_j
        up, down = self.uplink_j + self.uplink_datacenter_j, self.downlink_j + self.downlink_robots_j
        links = up, down, self.sidelink_j
        more = self.acting_robots_j, self.evaluating_robots_j, self.waiting_j, self.other_j
        return dict(zip(CAUSES, (*computing, *links, *more), strict=True))

    @property
    def by_site(self) -> dict[str, float]:
        """Joules of each site; with what is not told they are the total."""
        return {"datacenter": self.datacenter_j, "robots": self.robots_j}

    def plus(self, more: Mapping[str, float]) -> Cost:
        """With so many joules more, by the names of the fields.

        Raises:
            ValueError: no such field.
        """
        known = [each.name for each in fields(Cost)]
        if unknown := [name for name in more if name not in known]:
            raise ValueError(f"{', '.join(unknown)}: no such cause, expected {', '.join(known)}")
        return replace(self, **{name: getattr(self, name) + joules for name, joules in more.items()})


_NOTHING: Mapping[str, float] = {}


@dataclass(frozen=True)
class Bill:
    """The costs of an arm by phase, eq. (12). Bills add up."""

    ml: Cost = field(default_factory=Cost)  # meta-learning, eq. (8)
    fl: Cost = field(default_factory=Cost)  # what the tasks took, eq. (10)

    def __add__(self, other: Bill) -> Bill:
        return Bill(self.ml + other.ml, self.fl + other.fl)

    @property
    def both(self) -> Cost:
        """Both phases by cause."""
        return self.ml + self.fl

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
        return self.ml.total_j + self.fl.total_j

    @property
    def sums_j(self) -> dict[str, float]:
        """The total, and the same added up in the other two ways."""
        both = self.both
        return {
            "phases": self.total_j,
            "causes": sum(both.by_cause.values()) + both.untold_j,
            "sites": sum(both.by_site.values()) + both.untold_j,
        }

    def plus(self, ml: Mapping[str, float] = _NOTHING, fl: Mapping[str, float] = _NOTHING) -> Bill:
        """With so many joules more in each phase, by the names of the fields of `Cost`.

        Raises:
            ValueError: no such field.
        """
        return Bill(self.ml.plus(ml), self.fl.plus(fl))


def parts(bill: Bill | None, metered: bool = True) -> dict[str, Joules]:
    """A bill by phase, computing and traffic (`PARTS`).

    What needs bytes is None where none were `metered`; what a list does not tell is None; nothing is of nothing.
    """
    if bill is None:
        return dict.fromkeys(PARTS)
    found: dict[str, Joules] = {}
    for phase, cost in (("ml", bill.ml), ("fl", bill.fl)):
        told = cost.untold_j == 0
        found[f"{phase}_learning"] = cost.learning_j if told else None
        found[f"{phase}_communication"] = cost.communication_j if told and metered else None
        found[phase] = cost.total_j if metered else None
    return found | {"total": bill.total_j if metered else None}


_OF_BYTES = *CAUSES[2:5], CAUSES[-1]
COMPUTING = (
    "computing_datacenter_j",
    "computing_robots_j",
    "acting_robots_j",
    "evaluating_robots_j",
    "waiting_robots_j",
    "waiting_datacenter_j",
)
"""What is known of a cost where no bytes were metered."""


def causes_of(costs: Iterable[Cost | None]) -> tuple[Cause, ...]:
    """The causes that a table of these costs has."""
    spent = [cost.by_cause for cost in costs if cost]
    return tuple(cause for cause in CAUSES if cause in PAPER_CAUSES or any(each[cause] for each in spent))


def cause_parts(cost: Cost | None, metered: bool = True) -> dict[Cause, Joules]:
    """A cost by cause; traffic is None where no bytes were metered, everything where the list does not tell."""
    if cost is None or cost.untold_j:
        return dict.fromkeys(CAUSES)
    return {cause: joules if metered or cause not in _OF_BYTES else None for cause, joules in cost.by_cause.items()}


def site_parts(cost: Cost | None, metered: bool = True) -> dict[str, Joules]:
    """A cost by the site that pays it; neither is known without its traffic."""
    if cost is None or cost.untold_j or not metered:
        return dict.fromkeys(SITES)
    return dict(cost.by_site)
