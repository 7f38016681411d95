"""The price door: lists that turn an arm's facts into its bill, ours and those that a user brings.

`energy.prices` names them. All are opened, and a user's are tried on small made-up facts, before anything is started;
each bill is checked, and what is wrong with a list is told by its name.
"""

from __future__ import annotations

import inspect
import math
import re
import traceback
from collections.abc import Iterable
from typing import Any, Protocol

from jouleswarm.common.doors import SHIPPED, Kind
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.bill import Bill
from jouleswarm.energy.facts import STAGE, Counts, Facts, Flow, UnknownFactError, Work
from jouleswarm.energy.published import published

_NAME = re.compile(r"[A-Za-z0-9_-]{1,40}")
_TAKEN = ("by_cause", "by_site", "total", "paper")
_PAPERS = ("literal", "published")
_CLOSE = 1e-9


class PriceList(Protocol):
    """One way to price; pure, without files. Its label heads a column of every table, its name is a key."""

    @property
    def name(self) -> str:
        """Letters, digits, _ and -: a key of summary.json and of CSV tables."""

    @property
    def label(self) -> str:
        """In tables and figures."""

    def price(self, facts: Facts, energy: Energy) -> Bill | None:
        """Joules by phase, cause and site; None where the list is not defined. `energy.beta` is a number."""


class Priced(Protocol):
    """A scenario, or a tariff by itself."""

    @property
    def energy(self) -> Energy: ...
    def open(self, kind: Kind, name: str) -> Any: ...


def price_lists(scenario: Priced) -> tuple[PriceList, ...]:
    """What `energy.prices` names, in its order; lists that do not ship here have been tried.

    Raises:
        ConfigurationError: one that cannot be used: one line that says which and why.
    """
    lists: list[PriceList] = []
    for name in scenario.energy.prices:
        found = open_list(scenario, name)
        for other in lists:
            if found.name == other.name or found.label == other.label:
                raise ConfigurationError(
                    f"price list {name!r}: its name {found.name!r} or label {found.label!r} is that of another list "
                    "of energy.prices; give it others"
                )
        lists.append(found)
    return tuple(lists)


def open_list(scenario: Priced, name: str) -> PriceList:
    """One list by its name, tried if it does not ship here; as `price_lists`."""
    found = scenario.open("prices", name)
    if name in SHIPPED["prices"]:
        shipped: PriceList = found
        return shipped
    where = f"price list {name!r}"
    tried = _checked(_made(found, where), where)
    plain = scenario.energy.for_fleet((), None)  # a user's table of links knows nothing of made-up robots
    for facts in _MADE_UP:
        _price(tried, facts, with_beta(plain, facts), where)
    return tried


def own_lists(lists: Iterable[PriceList]) -> list[PriceList]:
    """Those that have a column, row or panel of their own: all but the paper's two."""
    return [each for each in lists if each.name not in _PAPERS]


def price(prices: PriceList, facts: Facts, energy: Energy) -> Bill | None:
    """The bill of an arm by a list; None where the list is not defined, or needs what is not known of these facts.

    Raises:
        ConfigurationError: the list fails, or its bill does not add up; or beta is to be the measured one, and none
            was measured in this run.
    """
    return _price(prices, facts, with_beta(energy, facts), f"price list {prices.name!r}")


def is_whole(prices: PriceList, facts: Facts) -> bool:
    """Whether a bill is all there is: bytes were counted, or the list asks for none."""
    return facts.metered or prices is published


def with_beta(energy: Energy, facts: Facts) -> Energy:
    """`energy` with a number for beta: as given, or where it is "measured" what the data center measured; 1 of methods
    of first order, which have nothing that could cost it.

    Raises:
        ConfigurationError: the arm's method was not measured in this run.
    """
    if not facts.exact:
        return energy if energy.beta == 1 else energy.model_copy(update={"beta": 1.0})
    if energy.beta != "measured":
        return energy
    if facts.beta is None:
        raise ConfigurationError(
            f"beta of {facts.method} was not measured in this run; run it with --set energy.beta=measured, or give "
            "--beta a number (`python -m benchmarks.meta_gradient` measures one)"
        )
    return energy.model_copy(update={"beta": facts.beta})


def _price(prices: PriceList, facts: Facts, energy: Energy, where: str) -> Bill | None:
    try:
        bill = prices.price(facts, energy)
    except UnknownFactError:
        return None
    except ConfigurationError:  # of what it was given
        raise
    except Exception as error:  # whatever a user's list does
        raise ConfigurationError(
            f"{where}: price() fails on {_arm(facts)}: {type(error).__name__}: {error}{_line(error)}"
        ) from error
    if bill is None:
        return None
    if not isinstance(bill, Bill):
        raise ConfigurationError(
            f"{where}: price() gave {type(bill).__name__} for {_arm(facts)}, expected Bill or None"
        )
    if prices.name in _PAPERS and math.isfinite(bill.total_j):  # tests hold these to add up; studies ask a lot of them
        return bill
    sums = bill.sums_j
    total = sums["phases"]
    if not all(math.isclose(each, total, rel_tol=_CLOSE, abs_tol=_CLOSE) for each in sums.values()) or math.isinf(
        total
    ):
        told = ", ".join(f"{each:g} J over {name}" for name, each in sums.items())
        raise ConfigurationError(f"{where}: the bill of {_arm(facts)} does not add up: {told}")
    return bill


def _line(error: Exception) -> str:
    """The last line of the list's own file that the error came through."""
    frames = traceback.extract_tb(error.__traceback__)[1:]
    lines = [frame.lineno for frame in frames if frame.filename == frames[0].filename]
    return f" (line {lines[-1]})" if lines else ""


def _made(found: Any, where: str) -> Any:
    """A list that is ready: of a class an object of it."""
    if not inspect.isclass(found):
        return found
    try:
        return found()
    except Exception as error:  # whatever a user's class does
        raise ConfigurationError(
            f"{where}: {found.__name__}() fails: {type(error).__name__}: {error}; a list is made without arguments"
        ) from error


def _checked(found: Any, where: str) -> PriceList:
    """`found`, if it is what a list must be."""
    if not callable(getattr(found, "price", None)):
        raise ConfigurationError(f"{where}: has no price(facts, energy); see docs/doors.md")
    name, label = getattr(found, "name", None), getattr(found, "label", None)
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ConfigurationError(f"{where}: its name is {name!r}, expected letters, digits, _ and -, 40 at most")
    if not isinstance(label, str) or not label.strip() or len(label) > 100 or not label.isprintable():
        raise ConfigurationError(f"{where}: its label is {label!r}, expected what heads its column, in one line")
    if name in (*SHIPPED["prices"], *_TAKEN):
        raise ConfigurationError(f"{where}: its name {name!r} is taken; give it another")
    priced: PriceList = found
    return priced


def _arm(facts: Facts) -> str:
    return f"arm {facts.arm}" if facts.arm else "made-up facts"


def _made_up(t0: int) -> Facts:
    """Two clusters of two robots: a round and a kilobyte of everything, behind it a phase ml of `t0` rounds."""

    def flow(phase: Any, task: int, link: Link, sender: str, receiver: str) -> Flow:
        return Flow(phase, task, link, sender, receiver, 1, 1000, 1050)

    fl = Counts(gradients_robots=2, sidelink_bytes=2000, sidelink_sent_bytes=2000)
    ml = Counts(gradients_support=1, gradients_query=1, uplink_bytes=1000, downlink_bytes=4000)
    pairs = {1: (1, 2), 2: (3, 4)}
    sides = [(task, *pair) for task, (one, two) in pairs.items() for pair in ((one, two), (two, one))]
    flows = [flow("fl", task, Link.SIDELINK, f"agent-{one}", f"agent-{two}") for task, one, two in sides]
    sent = [Flow("fl", task, Link.SIDELINK, f"agent-{one}", "", 1, 1000, 1050) for task, one, _ in sides]
    work: list[Work] = [Work("fl", task, robot, 1, 0, 0.5, 1, 10, 10) for task, robot, _ in sides]
    if t0:
        flows.append(flow("ml", 1, Link.UPLINK, "agent-1", "datacenter"))
        flows += [flow("ml", STAGE, Link.DOWNLINK, "datacenter", f"agent-{robot}") for _, robot, _ in sides]
        work += [Work("ml", 1, 0, 1, 1, 0.5, 1), Work("ml", 1, 1, 0, 0, 0.5, 1, 10)]
    return Facts(
        arm="",
        method="maml" if t0 else "fl",
        t0=t0,
        parts={**({("ml", STAGE): ml} if t0 else {}), ("fl", 1): fl, ("fl", 2): fl},
        rounds={1: 1, 2: 1},
        robots={1: 2, 2: 2},
        links={1: 2, 2: 2},
        training_robots=1,
        known_flows=tuple(flows),
        known_work=tuple(work),
        known_sent=tuple(sent),
    )


_MADE_UP = (_made_up(1), _made_up(0))
