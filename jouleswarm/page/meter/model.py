"""What the page shows of a meter, as data: what passed first, prices on it afterwards. Pure; no browser, no files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.tally import Direction, Row
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.tariff import Tariff
from jouleswarm.common.wire.rules import OTHER
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.bill import Cost, causes_of
from jouleswarm.energy.calculator import facts_of
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.prices import PriceList, price
from jouleswarm.metering.cost import Done, done_of
from jouleswarm.metering.metered import Metered
from jouleswarm.metering.windows import joined
from jouleswarm.page import prices
from jouleswarm.report.metered import client_name, metered_notes, published
from jouleswarm.report.sliders import LINK_SLIDERS, SLIDERS

MOST_CLIENTS, _MOST_WINDOWS = 12, 60
_MOST_ROWS, _MOST_BUSY = 200, 20
LINKS = (*(link.value for link in Link), OTHER)
_IN_LINKS = ("uplink", "downlink", "sidelinks")  # causes that links tell


class Passed(NamedTuple):
    """Messages that belong together."""

    sent_bytes: int
    """Payload that clients published."""
    got_bytes: int
    """Payload that clients were delivered."""
    facts: tuple[Facts, ...]
    """What is priced of them."""

    @property
    def bytes(self) -> int:
        """Of both."""
        return self.sent_bytes + self.got_bytes


class Client(NamedTuple):
    """What one client, or all others, sent and got over each link."""

    name: str
    number: int
    """How many they are."""
    by_link: Mapping[str, Passed]


class Busy(NamedTuple):
    """A client on the topics of a rule, or on one that no rule matches, in one direction."""

    direction: Direction
    client: str
    link: str
    topics: str
    """The rule's filter, or the topic."""
    messages: int
    packet_bytes: int
    passed: Passed


class Moment(NamedTuple):
    """What passed from a moment to the next."""

    begin_s: float
    """Since 1970."""
    passed: Passed


@dataclass(frozen=True)
class MeterShown:
    """All that the page shows but prices."""

    metered: Metered
    status: str
    """running, complete or interrupted."""
    tariff: Tariff
    facts: tuple[Facts, ...]
    """Of all, with what clients told that they computed."""
    links: Mapping[str, Passed]
    clients: tuple[Client, ...]
    busiest: tuple[Busy, ...]
    moments: tuple[Moment, ...]
    notes: tuple[str, ...]

    @property
    def number(self) -> int:
        """How many clients there are."""
        return sum(client.number for client in self.clients)

    @property
    def hub(self) -> str:
        """What stands between the clients."""
        return "server" if "of" in self.metered.manifest else "broker"

    @property
    def tells_time(self) -> bool:
        """Whether counts are by windows."""
        return self.hub == "broker"

    @cached_property
    def sliders(self) -> tuple[prices.Slider, ...]:
        """Those of links; with those of computing where clients told of any."""
        computing = [each for each in SLIDERS if each.key in ("pk_w", "tk_batch_s")]
        return (*LINK_SLIDERS, *(computing if self.metered.told else ()))

    @property
    def prices(self) -> PriceList:
        """The first that the meter's prices name."""
        return self.metered.price_lists[0]


class MeterPriced(NamedTuple):
    """Joules at some prices. None: not known."""

    energy: Energy
    total_j: float | None
    links_j: Mapping[str, float | None]
    other_causes_j: Mapping[str, float]
    """Of what is no message: cause, in words -> joules."""
    clients_j: Sequence[Mapping[str, float | None]]
    """Of each client by link."""
    busiest: Sequence[tuple[Busy, float | None]]
    """Those that cost most first."""
    moments_j: Sequence[float | None]


def meter_shown(metered: Metered, *, running: bool) -> MeterShown:
    """What is known by now.

    Raises:
        ConfigurationError: the prices ask for what was not metered, of who sent something say.
    """
    tariff, _ = metered.priced()
    done, rows = done_of(metered, tariff), published(metered)
    facts = facts_of(metered.bill_rows, by_robot=tariff.is_by_robot) if metered.bill_rows else {}
    return MeterShown(
        metered=metered,
        status="running" if running else metered.status,
        tariff=tariff,
        facts=tuple(facts.values()),
        links=_by_link(rows, done),
        clients=tuple(_clients(rows, done)),
        busiest=tuple(_busiest(rows, done)),
        moments=tuple(_moments(metered, done)),
        notes=tuple(metered_notes(metered)),
    )


def meter_priced(shown: MeterShown, positions: Mapping[str, float]) -> MeterPriced:
    """The same facts at the sliders' prices."""
    energy = shown.tariff.energy
    if moved := prices.changes(positions, energy):
        energy = shown.metered.priced(moved)[0].energy

    def cost(facts: Iterable[Facts]) -> Cost | None:
        try:
            bills = [price(shown.prices, each, energy) for each in facts]
        except ConfigurationError:  # a list of the user's own: told with the report's bill
            return None
        return sum((bill.both for bill in bills if bill), Cost()) if None not in bills else None

    def joules(passed: Passed) -> float | None:
        found = cost(passed.facts)
        return None if found is None else found.total_j

    whole = cost(shown.facts)
    causes = {cause.label: whole.by_cause[cause] for cause in causes_of([whole])} if whole else {}
    busiest = [(busy, joules(busy.passed)) for busy in shown.busiest]
    busiest.sort(key=lambda each: (-(each[1] or 0.0), -each[0].packet_bytes))
    return MeterPriced(
        energy=energy,
        total_j=None if whole is None else whole.total_j,
        links_j={link: joules(passed) for link, passed in shown.links.items()},
        other_causes_j={cause: each for cause, each in causes.items() if each and cause not in _IN_LINKS},
        clients_j=[{link: joules(each) for link, each in client.by_link.items()} for client in shown.clients],
        busiest=busiest[:_MOST_BUSY],
        moments_j=[joules(moment.passed) for moment in shown.moments],
    )


def _passed(rows: Sequence[Row], done: Done) -> Passed:
    sent, got = (sum(row.payload_bytes for row in rows if row.direction == way) for way in ("in", "out"))
    return Passed(sent, got, done(rows))


def _by_link(rows: Sequence[Row], done: Done) -> dict[str, Passed]:
    """In the order of LINKS."""
    found = {link: [row for row in rows if row.link == link] for link in LINKS}
    return {link: _passed(held, done) for link, held in found.items() if held}


def _clients(rows: Iterable[Row], done: Done) -> list[Client]:
    """Who moved most first, and all others as one."""
    held: dict[str, list[Row]] = {}
    for row in rows:
        if name := client_name(row):
            held.setdefault(name, []).append(row)
    names = sorted(held, key=lambda name: (-sum(row.payload_bytes for row in held[name]), name))
    found = [Client(name, 1, _by_link(held[name], done)) for name in names[:MOST_CLIENTS]]
    if rest := names[MOST_CLIENTS:]:
        others = [row for name in rest for row in held[name]]
        found.append(Client(f"{len(rest)} others", len(rest), _by_link(others, done)))
    return found


def _busiest(rows: Iterable[Row], done: Done) -> Iterator[Busy]:
    held: dict[tuple[Direction, str, str, str], list[Row]] = {}
    for row in rows:
        key = row.direction, client_name(row), row.link, row.rule or row.topic
        if key[1]:
            held.setdefault(key, []).append(row)
    moved = {key: sum(row.packet_bytes for row in found) for key, found in held.items()}
    for key in sorted(held, key=lambda key: -moved[key])[:_MOST_ROWS]:
        yield Busy(*key, sum(row.messages for row in held[key]), moved[key], _passed(held[key], done))


def _moments(metered: Metered, done: Done) -> list[Moment]:
    """Evenly, also where nothing passed."""
    held = joined(metered.windows, _MOST_WINDOWS)
    if not held:
        return []
    begin_s, step_s = held[0].begin_s, held[0].window_s
    rows = {round((each.begin_s - begin_s) / step_s): each.rows for each in held}
    return [
        Moment(
            begin_s + number * step_s,
            _passed([row for row in rows.get(number, ()) if row.kind == "publish"], done),
        )
        for number in range(max(rows) + 1)
    ]
