"""`jouleswarm run --dry`: what a scenario will cost, on the terminal."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rich.console import Console

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.bill import CAUSES
from jouleswarm.energy.facts import Counts
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price, price_lists
from jouleswarm.report.arms import labels
from jouleswarm.report.format import bytes_text, joules_text
from jouleswarm.report.table import Table, show
from jouleswarm.runs.foretold import foretold_facts, room_of, round_lines
from jouleswarm.runs.speed import estimated_s, measure_speed

_PHASES = {"ml": "stage", "fl": "tasks"}


def print_foretold(scenario: Scenario, rounds: int | None = None, console: Console | None = None) -> None:
    """Print a round, the whole, room and time; `rounds`: of each task, beside the most that there can be."""
    console = console or Console()
    room, speed = room_of(scenario), measure_speed(scenario)
    for table in (_round(scenario), _whole(scenario, rounds)):
        show(table, console)
    center = f", the data center {bytes_text(room.datacenter)}" if room.datacenter else ""
    processes = len(scenario.agents) + scenario.needs_datacenter
    one = f"a gradient {speed.gradient_s * 1e3:.3g} ms and a motion {speed.motion_s * 1e3:.3g} ms of processor time"
    lines = [
        f"Memory: a robot {bytes_text(room.robot)}{center}, in all {bytes_text(room.whole)}: replay and weights at "
        f"their fullest. On top, Python and PyTorch in each of {processes} processes: "
        f"{bytes_text(speed.process_bytes)} here, most of it shared.",
        f"Disk: {bytes_text(room.disk)} of states, frames and weights; what is left at the end is less.",
        *(
            f"Time, estimate: {estimated_s(scenario, speed, each) / 60:.3g} minutes here, if nothing else runs and "
            f"each task takes {each} rounds: {one}, timed just now."
            for each in _rounds(scenario, rounds)
        ),
        experience_line(scenario, has_guide=speed.has_guide),
        "By the closed form: payload without headers and MQTT's bytes, nothing sent twice, no control, greedy episodes "
        "not priced; png observations as raw ones. Afterwards the report holds this against what was counted.",
    ]
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True)


def foretold_document(scenario: Scenario, rounds: int | None = None) -> dict[str, Any]:
    """The same as plain data: joules by price list, bytes, seconds."""
    speed, wholes = measure_speed(scenario), []
    for each in _rounds(scenario, rounds):
        for arm in scenario.arms:
            facts = foretold_facts(scenario, arm, arm.t0, each)
            bills = {prices.name: price(prices, facts, scenario.energy) for prices in price_lists(scenario)}
            counts: Counts = facts.counts.ml + facts.counts.fl
            joules = {name: bill and bill.total_j for name, bill in bills.items()}
            wholes.append({"arm": arm.name, "rounds": each, "counts": asdict(counts), "joules": joules})
    return {
        "scenario": scenario.name,
        "a_round": [line._asdict() for line in round_lines(scenario)],
        "whole": wholes,
        "bytes": room_of(scenario)._asdict(),
        "seconds_here": {str(each): estimated_s(scenario, speed, each) for each in _rounds(scenario, rounds)},
    }


def experience_line(scenario: Scenario, *, has_guide: bool) -> str:
    """Whom robots follow while they collect, as it comes out with this environment."""
    learning, trains = scenario.learning, bool(scenario.meta_methods)
    guided = has_guide and learning.collect == "guide"
    whom = "the environment's guide" if guided else "their own policy"
    told = f"Experience: robots follow {whom}, {learning.epsilon:.3g} of their actions random, from {learning.starts}"
    if learning.collect == "guide" and not has_guide:
        told += " (learning.collect is guide, and this environment has none)"
    random = scenario.meta_epsilon if has_guide else 1.0
    if trains and (not guided or (random, scenario.meta_starts) != (learning.epsilon, learning.starts)):
        whom = "the guide" if has_guide else "nobody"
        told += f"; those whose experience trains the data center follow {whom}, {random:.3g}, {scenario.meta_starts}"
    return told + "."


def _rounds(scenario: Scenario, rounds: int | None) -> list[int]:
    return [*([rounds] if rounds else []), scenario.federation.max_rounds]


def _round(scenario: Scenario) -> Table:
    names, rows = labels(scenario), []
    causes = {cause.key: cause.label for cause in CAUSES}
    for line in round_lines(scenario):
        is_link = line.cause in ("uplink", "downlink", "sidelink")
        amount = bytes_text(line.amount) if is_link else f"{line.amount:g} gradients" if line.amount else ""
        what = causes[line.cause] + (", once" if line.once else "")
        rows.append([names[line.arm], _PHASES[line.phase], what, amount, joules_text(line.joules)])
    return Table(f"A round of all clusters together, {literal.label}", ["arm", "of", "what", "", "joules"], rows)


def _whole(scenario: Scenario, rounds: int | None) -> Table:
    lists, rows = price_lists(scenario), []
    for each in _rounds(scenario, rounds):
        for arm in scenario.arms:
            facts = foretold_facts(scenario, arm, arm.t0, each)
            both: Counts = facts.counts.ml + facts.counts.fl
            moved = (both.uplink_bytes, both.downlink_bytes, both.sidelink_bytes)
            bills = (price(prices, facts, scenario.energy) for prices in lists)
            joules = (joules_text(bill.total_j if bill else None) for bill in bills)
            rows.append([labels(scenario)[arm.name], str(each), *map(bytes_text, moved), *joules])
    headings = ["arm", "rounds a task", "up", "down", "sidelinks", *(prices.label for prices in lists)]
    return Table("The whole, if each task takes so many rounds", headings, rows)
