"""What the page shows of a run, as data: what was done first, prices on it afterwards. Pure; no browser, no files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import fmean
from typing import NamedTuple

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.types import RowPhase
from jouleswarm.energy.bill import Bill, causes_of
from jouleswarm.energy.carbon import at_sites, carbon, has_carbon
from jouleswarm.energy.curves import until
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import PriceList, own_lists, price, price_lists
from jouleswarm.report.arms import colours, label
from jouleswarm.runs.arm_facts import in_closed_form
from jouleswarm.runs.events import Event
from jouleswarm.runs.run import Run
from jouleswarm.runs.sizes import scenario_sizes

OVER = ("complete", "interrupted", "failed")
_MOST_POINTS = 40  # of a growth curve; a bill for each is made anew at every move of a slider


class Moved(NamedTuple):
    """Payload bytes from one process to another, all arms together."""

    link: str
    """uplink, downlink or sidelink."""
    sender: str
    receiver: str
    bytes: float


class Curve(NamedTuple):
    """Rewards by round: R of a cluster (`agent` None), or a robot's own greedy episodes."""

    arm: str
    task: int
    agent: int | None
    points: tuple[tuple[int, float], ...]


@dataclass(frozen=True)
class ArmDone:
    """What an arm has done so far."""

    name: str
    label: str
    colour: str
    t0: int
    rounds: Mapping[int, int]
    """Task -> rounds."""
    learned: Mapping[int, bool]
    over: frozenset[int]
    """Tasks whose cluster has ended, learned or not."""
    facts: Facts
    growth: tuple[tuple[int, Facts], ...]
    """What had been done after some of the rounds."""


@dataclass(frozen=True)
class Shown:
    """All that the page shows but prices."""

    run: Run
    status: str
    """starting, running, complete, interrupted, failed or listening."""
    seconds: float
    prices: PriceList
    counted: bool
    """Whether bytes were counted; else they are those of the closed form."""
    arms: tuple[ArmDone, ...]
    moved: tuple[Moved, ...]
    curves: tuple[Curve, ...]
    events: tuple[Event, ...] = ()
    paths: Mapping[tuple[str, int], tuple[tuple[int, int], ...]] = field(default_factory=dict)
    """(arm, task) -> cells that the learned model's greedy episode goes through."""

    @property
    def scenario(self) -> Scenario:
        """What is run."""
        return self.run.scenario

    @property
    def is_over(self) -> bool:
        """Whether nothing more comes."""
        return self.status in OVER


class ArmPriced(NamedTuple):
    """An arm at some prices. None: not known."""

    done: ArmDone
    total_j: float | None
    causes: Mapping[str, float]
    """Cause, in words -> joules."""
    grams: float | None
    growth: tuple[tuple[int, float], ...]
    """(round, joules by then)."""


def shown(run: Run, status: str, seconds: float, events: Sequence[Event] = ()) -> Shown:
    """What is known of a run by now."""
    done = tuple(_arms(run))
    return Shown(
        run=run,
        status=status,
        seconds=seconds,
        prices=_prices(run.scenario),
        counted=bool(run.meter_rows) or not run.rows,
        arms=done,
        moved=tuple(_moved(done)),
        curves=tuple(_curves(run)),
        events=tuple(events),
    )


def priced(arm: ArmDone, prices: PriceList, energy: Energy) -> ArmPriced:
    """An arm's bill by cause, and how it grew."""
    bill = _bill(arm.facts, prices, energy)
    if bill is None:
        return ArmPriced(arm, None, {}, None, ())
    causes = {cause.label: bill.both.by_cause[cause] for cause in causes_of([bill.both])}
    grams = carbon(bill, at_sites(energy, arm.facts)).total_g if has_carbon(energy) else None
    grown = ((round_, _bill(facts, prices, energy)) for round_, facts in arm.growth)
    growth = tuple((round_, each.total_j) for round_, each in grown if each is not None)
    return ArmPriced(arm, bill.total_j, causes, grams, growth)


def _bill(facts: Facts, prices: PriceList, energy: Energy) -> Bill | None:
    try:
        return price(prices, facts, energy)
    except ConfigurationError:  # beta that is not measured yet, or a list of the user's own: told with the bill
        return None


def _prices(scenario: Scenario) -> PriceList:
    """The equations, unless the scenario names other lists only."""
    lists = price_lists(scenario)
    return literal if literal in lists else next(iter(own_lists(lists)), literal)


def _arms(run: Run) -> Iterator[ArmDone]:
    painted = colours(run.scenario)
    for arm in run.scenario.arms:
        results = run.results[arm.name]
        facts = _facts(run, arm.name)
        yield ArmDone(
            name=arm.name,
            label=label(run.scenario, arm),
            colour=painted[arm.name],
            t0=run.t0[arm.name],
            rounds={result.task: result.rounds for result in results},
            learned={result.task: result.learned for result in results},
            over=_over(run, arm.name),
            facts=facts,
            growth=tuple((round_, until(facts, round_)) for round_ in _some_rounds(facts)),
        )


def _facts(run: Run, arm: str) -> Facts:
    """What was counted; the closed form of the rounds where nothing was."""
    facts = run.facts[arm]
    if facts.metered or not any(facts.rounds.values()):
        return facts
    return in_closed_form(facts, run.scenario, run.mean_rounds(arm), scenario_sizes(run.scenario))


def _over(run: Run, arm: str) -> frozenset[int]:
    """Tasks all of whose robots have told their last row of the arm."""
    last = {row.agent for row in run.rows if (row.arm, row.phase) == (arm, RowPhase.FL) and row.learned is not None}
    return frozenset(task for task, cluster in run.scenario.clusters.items() if last.issuperset(cluster))


def _some_rounds(facts: Facts) -> list[int]:
    """From 0, the stage alone, to the last, evenly."""
    last = int(max(facts.rounds.values(), default=0))
    return [*range(0, last, max(1, -(-last // _MOST_POINTS))), last]


def _moved(arms: Sequence[ArmDone]) -> Iterator[Moved]:
    """Bytes of every link; arms that share a stage are charged for it each, but it was moved once."""
    found: dict[tuple[str, str, str], float] = {}
    newest = {arm.facts.method: arm.name for arm in arms}  # the last arm of a method has its whole stage
    for arm in arms:
        for flow in arm.facts.known_flows or ():
            if (flow.phase, flow.link) != ("ml", "uplink") or newest[arm.facts.method] == arm.name:
                key = str(flow.link), flow.sender, flow.receiver
                found[key] = found.get(key, 0.0) + flow.payload_bytes
    for key, count in found.items():
        yield Moved(*key, count)


def _curves(run: Run) -> Iterator[Curve]:
    clusters: dict[tuple[str, int], dict[int, list[float]]] = {}
    robots: dict[tuple[str, int, int], dict[int, float]] = {}
    for row in run.rows:
        if row.phase != RowPhase.FL or not row.agent:
            continue
        if row.cluster_reward is not None:
            clusters.setdefault((row.arm, row.task), {}).setdefault(row.round, []).append(row.cluster_reward)
        if row.reward is not None:
            robots.setdefault((row.arm, row.task, row.agent), {})[row.round] = row.reward
    for (arm, task), rewards in sorted(clusters.items()):
        yield Curve(arm, task, None, tuple((round_, fmean(rewards[round_])) for round_ in sorted(rewards)))
    for (arm, task, agent), held in sorted(robots.items()):
        yield Curve(arm, task, agent, tuple(sorted(held.items())))
