"""The sentences of a report: its headline, and what to know before quoting a figure of it."""

from __future__ import annotations

from collections.abc import Sequence

from jouleswarm.common.scenario.arms import snapshot_of
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.carbon import at_sites, has_carbon
from jouleswarm.energy.literal import downlink_bit_per_j, literal
from jouleswarm.energy.prices import own_lists
from jouleswarm.energy.published import CLUSTER_ROBOTS, TRAINING_ROBOTS, published, published_bill
from jouleswarm.methods.method import Method
from jouleswarm.report.arms import labels
from jouleswarm.report.format import bytes_text
from jouleswarm.report.values import values_that_ran_away
from jouleswarm.runs.columns import closed_facts
from jouleswarm.runs.conservation import Balance, conservation
from jouleswarm.runs.directory import computed_on
from jouleswarm.runs.foretold import compare
from jouleswarm.runs.paper import is_papers_deployment
from jouleswarm.runs.run import Run
from jouleswarm.runs.traffic import metered_by


def headline(run: Run, energy: Energy) -> str:
    """One line: how the run ended and what it is priced at."""
    line = (
        f"{run.status}, seed {run.scenario.seed}; E_UL {energy.ul_bit_per_j / 1e3:g}, "
        f"E_DL {downlink_bit_per_j(energy) / 1e3:g}, E_SL {energy.sl_bit_per_j / 1e3:g} kb/J, "
        f"sidelinks {energy.sidelink.replace('_', ' ')}, PUE {energy.pue:g}, beta {energy.beta}"
    )
    if not has_carbon(energy):
        return line
    known = at_sites(energy)
    sites = {"data center": known.datacenter_g_per_kwh, "robots": known.robots_g_per_kwh}
    told = (f"{site} {'unknown' if value is None else f'{value:g}'}" for site, value in sites.items())
    return f"{line}; gCO2e/kWh: {', '.join(told)}"


def warnings(run: Run) -> list[str]:
    """What stands before everything else: that a bill is not to be trusted, or what was learned is none."""
    found = []
    if run.misfits:
        told = (run.summary or {}).get("counters") or "the broker's counters"
        found.append(
            f"{_do_not_fit(run.misfits)} This bill is fed by {told}, and is not to be trusted: "
            "run it again, on a broker that keeps its counters for the whole run."
        )
    return found + values_that_ran_away(run)


def notes(run: Run, energy: Energy) -> list[str]:
    """What a reader must know before quoting a figure of this report."""
    lines = [
        *_notes_of_the_run(run),
        *_notes_of_the_arms(run),
        *_notes_of_the_processors(run),
        *_notes_of_the_columns(run),
    ]
    if published in run.price_lists and any(method.in_paper for method in _methods(run)):
        lines.append(_note_of_the_published_prices(run.scenario, energy))
    if energy.dl_bit_per_j is None:
        lines.append("E_DL is not given by the paper and taken as E_UL.")
    lines.append(
        "Sites: robots pay their computing, what they send up and direct sidelinks; the data center pays its "
        "computing and what is sent down."
    )
    if has_carbon(energy):
        lines.append("gCO2e = J / 3.6e6 x the site's gCO2e/kWh. A site without an intensity is unknown, not zero.")
    lines.append("Control and telemetry are counted apart and in no bill.")
    return lines + _notes_of_the_foretold(run) + notes_of_faults(run)


def _notes_of_the_foretold(run: Run) -> list[str]:
    """What `jouleswarm run --dry` says of these rounds, against what was counted."""
    told = []
    for arm, name in labels(run.scenario).items():
        facts = run.facts[arm]
        for what, (said, was) in compare(closed_facts(run, arm), facts).items() if facts.metered else ():
            ratio = f"{was / said:.4f}" if said else "none foretold"
            told.append(f"{name}, {what} {bytes_text(said)} and {bytes_text(was)} ({ratio})")
    return [f"Foretold and counted, bytes a round: {'; '.join(told)}."] if told else []


def _methods(run: Run) -> list[Method]:
    return [run.scenario.method(name) for name in run.scenario.method_names]


def _notes_of_the_columns(run: Run) -> list[str]:
    lines, own = [], own_lists(run.price_lists)
    if literal in run.price_lists:
        which = "The last four" if not own else "Table I sizes, scenario sizes and the counted ones"
        lines.append(
            f"Column paper is as printed, all others are for this run's rounds. {which} are equations (8)-(12), with "
            "Table I's batches and bytes, with the scenario's, and with gradients and bytes as counted, without and "
            "with MQTT's own bytes."
        )
    if own:
        told = "; ".join(f"{each.label} ({name})" for each, name in zip(own, _named(run), strict=True))
        lines.append(f"Price lists beside the paper's, over the same facts: {told}.")
    return lines


def _named(run: Run) -> list[str]:
    """Names in the scenario of the lists beside the paper's."""
    own = own_lists(run.price_lists)
    return [name for name, each in zip(run.scenario.energy.prices, run.price_lists, strict=True) if each in own]


def _note_of_the_published_prices(scenario: Scenario, energy: Energy) -> str:
    if is_papers_deployment(scenario) and published_bill(0, 0, energy) is not None:
        return (
            "Published prices: 352.4 J a MAML round and 246.3 J an FL round of the paper's deployment, whatever PUE, "
            "beta and sizes are; the paper does not tell learning from communication."
        )
    return (
        f"Published prices are not defined here: they are the paper's deployment's, {TRAINING_ROBOTS} training robots "
        f"and clusters of {CLUSTER_ROBOTS}, over direct sidelinks at (E_UL, E_SL) = (200, 500) kb/J only."
    )


def _notes_of_the_arms(run: Run) -> list[str]:
    lines = []
    partners = {method.partners for method in _methods(run)}
    if any(snapshot_of(arm.name) is not None for arm in run.scenario.arms):
        lines.append(
            "Arms of one method share its meta-learning: its uplink was metered once, under the method's own arm, and "
            "each arm's bill has the part that carried the rounds up to its t0."
        )
    if "datacenter" in partners:
        lines.append("FedAvg and centralized learning have no E_ML: what the data center does is in their tasks' E_FL.")
    if "nobody" in partners:
        lines.append("Isolated robots stop one by one: t_i is the last one's, R and path error are their means.")
    return lines


def _notes_of_the_run(run: Run) -> list[str]:
    lines = []
    source = metered_by(run.meter_rows)
    if run.status != "complete":
        lines.append(f"This run is {run.status}: figures cover what was recorded.")
    if run.cut:
        lines.append(f"The last line of {' and '.join(run.cut)} is torn and left out.")
    if source is None:
        lines.append("No byte counters were written: communication was not counted, its columns are empty.")
    elif told := (run.summary or {}).get("counters"):
        lines.append(f"Metered by {told}.")
    elif source == "client":
        lines.append("Metered by the clients themselves.")
    unlearned = []
    for arm, name in labels(run.scenario).items():
        tasks = [str(found.task) for found in run.results[arm] if not found.learned]
        if tasks:
            unlearned.append(f"task{'s' if len(tasks) > 1 else ''} {', '.join(tasks)} by {name}")
    if unlearned:
        not_equal = "Energies are not at equal reward, and there is no verdict on these arms."
        lines.append(f"Not learned: {'; '.join(unlearned)}. {not_equal}")
    return lines


def _notes_of_the_processors(run: Run) -> list[str]:
    """On what it was computed: two runs can be compared bit by bit only where that is the same."""
    by_processor: dict[str, list[str]] = {}
    for client, processors in computed_on(run.manifest).items():
        for processor in dict.fromkeys(processors):
            by_processor.setdefault(processor, []).append(client)
    if len(by_processor) < 2:
        return [f"Computed on {processor}; elsewhere weights may differ in their bits." for processor in by_processor]
    told = "; ".join(f"{', '.join(clients)}: {processor}" for processor, clients in by_processor.items())
    return [f"Computed on different processors ({told}): on one of them alone weights may be others."]


def notes_of_faults(run: Run) -> list[str]:
    """What faults have cost in bytes; nothing where nothing has failed."""
    lines = []
    if empty := _emptied(run):
        lines.append(f"Batteries empty: {'; '.join(empty)}.")
    if any(row.missed for row in run.rows):
        lines.append(f"Robots went on without neighbours that were gone: {'; '.join(_missed(run))}.")
    found = conservation(run.meter_rows)
    if found is None:
        return lines
    if found.repeated[0]:
        lines.append(
            f"Retransmitted: {found.repeated[0]} messages, {found.repeated[1] / 1e6:.3g} MB of payload, came more than "
            "once because something had failed. They are in the bytes and in the bill."
        )
    if found.lost[0]:
        lines.append(
            f"Lost: {found.lost[0]} messages, {found.lost[1] / 1e6:.3g} MB of payload, were written to connections "
            "that broke before they were received. They are in the bytes and in the bill too."
        )
    if found.broken and not run.misfits:  # of a run cut short: the two sides stopped counting at other moments
        lines.append(_do_not_fit(found.broken))
    return lines


def _emptied(run: Run) -> list[str]:
    """Who stopped before its task was learned and its rounds were over: nothing but an empty battery does that."""
    names, most = labels(run.scenario), run.scenario.federation.max_rounds
    ends = [row for row in run.rows if row.learned is False and row.round < most]
    return [f"{names[row.arm]}: robot {row.agent} after round {row.round}" for row in ends]


def _do_not_fit(broken: Sequence[Balance]) -> str:
    worst = broken[0]
    return (
        f"The counters of broker and clients do not fit for {len(broken)} client and topic pairs, first "
        f"{worst.client} on {worst.topic}: acknowledged {worst.acknowledged}, received {worst.received}, delivered "
        f"{worst.delivered} (messages, bytes)."
    )


def _missed(run: Run) -> list[str]:
    """Who went on without whom in which rounds of which arm."""
    rounds: dict[tuple[str, int, int], list[int]] = {}
    for row in run.rows:
        for neighbour in row.missed:
            rounds.setdefault((row.arm, row.agent, neighbour), []).append(row.round)
    names = labels(run.scenario)
    return [
        f"{names[arm]}: robot {agent} without {neighbour} in {len(held)} rounds, {min(held)} to {max(held)}"
        for (arm, agent, neighbour), held in sorted(rounds.items())
    ]
