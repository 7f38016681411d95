"""The answer of a run in words, for whatever shows it: a title, and a line each on what a reader asks next. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.bill import Joules
from jouleswarm.report.arms import labels, method_label
from jouleswarm.report.everyday import everyday
from jouleswarm.report.format import joules_text
from jouleswarm.report.notes import notes_of_faults
from jouleswarm.report.ways import cause_words, way_words
from jouleswarm.runs.answer import TURNING, Answer, answer_of
from jouleswarm.runs.columns import COUNTED, columns
from jouleswarm.runs.run import Run

_SAME = 1.005
"""Factors below are no difference that a reader would quote."""
_AGREE = 0.03
"""Ways to price that differ by no more are told as one."""
_MOST_ARMS = 3
"""Told one by one in words; the table has all."""

_SYMBOLS = dict(zip(TURNING, ("E_UL", "E_SL"), strict=True))


class Said(NamedTuple):
    """The answer for readers."""

    title: str
    """One sentence: what costs how much more than what; or that there is no verdict."""
    lines: Sequence[tuple[str, str]]
    """(what is told, the words)."""
    changed: str = ""
    """Of other prices than the run's own: what they have made of it."""

    @property
    def rows(self) -> list[tuple[str, str]]:
        """The lines, of several that tell of one thing the name with the first alone."""
        names = [what for what, _ in self.lines]
        told = zip(["", *names], self.lines, strict=False)
        return [("" if what == before else what, words) for before, (what, words) in told]


def answer(run: Run, energy: Energy) -> Answer:
    """The answer of a run at these constants.

    Raises:
        ConfigurationError: a price list of the user's fails.
    """
    lists, trusted = run.price_lists, not run.misfits
    return answer_of(run.scenario, run.facts, run.results, energy, lists, status=run.status, trusted=trusted)


def said(run: Run, energy: Energy, found: Answer, before: Answer | None = None) -> Said:
    """The words of an answer at these constants; `before`: the same at others, to be told what has changed."""
    scenario, names = run.scenario, short_labels(run.scenario)
    lines = [("note", scenario.note)] if scenario.note else []
    lines += [("compared", each) for each in _compared(scenario)]
    lines.append(("learned", _learned(found, names)))
    lines += [("path error", each) for each in _path_errors(found, names)]
    lines += [("why", each) for each in _why(scenario, found, names)]
    lines += [("turns if", each) for each in _turns(found, energy, names)]
    lines += [("prices", each) for each in _other_prices(run, energy, found)]
    known = [spent.total_j for spent in found.arms.values() if spent.total_j]
    if 0 < len(known) == len(found.arms) <= _MOST_ARMS:
        lines.append(("that is", everyday(known)))
    if run.status != "complete":
        lines.append(("note", f"the run is {run.status}: all figures cover what was recorded"))
    if not all(facts.metered for facts in run.facts.values()):
        lines.append(("note", "bytes were not counted: what links have cost is not known, nor the whole"))
    if notes_of_faults(run):
        lines.append(("note", "something failed on the way, which is in the bill: --details says what"))
    return Said(title(found, names), lines, _changed(before, found, names) if before else "")


def short_labels(scenario: Scenario) -> dict[str, str]:
    """What arms are called in a sentence: by their methods alone, where that tells them apart."""
    methods, told = [arm.method for arm in scenario.arms], labels(scenario)
    alone = {arm.name: method_label(scenario, arm.method) for arm in scenario.arms if methods.count(arm.method) == 1}
    return told | alone


def title(found: Answer, names: Mapping[str, str]) -> str:
    """One sentence, by the names of the arms."""
    if len(found.against) == 1 and len(found.arms) == 2:
        (one,) = found.against
        joules = f"{joules_text(found.arms[one.arm].total_j)} against {joules_text(found.arms[one.other].total_j)}"
        return f"{names[one.arm]} {factor_words(one.factor)} {names[one.other]}: {joules}"
    if (cheapest := found.cheapest) is not None:
        count, of_all = len(found.against) + 1, len(found.arms)
        of = f"all {count} arms, which" if count == of_all else f"the {count} of {of_all} arms that"
        told = f"{names[cheapest.arm]} costs least of {of} learned all tasks"
        return f"{told}: {joules_text(cheapest.total_j)}"
    if len(found.arms) == 1:
        (spent,) = found.arms.values()
        told = "all tasks" if spent.has_learned else f"{spent.learned} of {spent.tasks} tasks"
        cost = "joules unknown: bytes were not counted" if spent.total_j is None else joules_text(spent.total_j)
        return f"{names[spent.arm]} learned {told}; {cost}"
    return f"No verdict: {_reason(found, names)}"


def factor_words(factor: float) -> str:
    """Joules of one over those of another, as a verb: `costs 46 times as much as`, `saves a factor of 2.3 over`."""
    if 1 / _SAME < factor < _SAME:
        return "costs the same as"
    told = factor_text(max(factor, 1 / factor))
    return f"costs {told} times as much as" if factor > 1 else f"saves a factor of {told} over"


def factor_text(factor: float) -> str:
    """`46`, `1.02`, `0.43`."""
    return f"{factor:.3g}" if 0.9 < factor < 1.1 else f"{factor:.2g}" if factor < 99.5 else f"{factor:,.0f}"


def _reason(found: Answer, names: Mapping[str, str]) -> str:
    if found.status != "complete":
        return f"the run is {found.status}"
    if any(spent.total_j is None for spent in found.arms.values()):
        return "bytes were not counted, or the price list has no bill here"
    if not found.trusted:
        return "the counters of broker and clients contradict each other"
    unlearned = [names[arm] for arm, spent in found.arms.items() if not spent.has_learned]
    if not unlearned:
        return f"{names[found.plain]} learned all tasks before the first round and spent nothing"
    who = f"{', '.join(unlearned)} did not learn" if len(unlearned) < len(found.arms) else "no arm learned"
    return f"{who} all tasks, and joules at unequal reward cannot be compared"


def _changed(before: Answer, now: Answer, names: Mapping[str, str]) -> str:
    """What other prices have made of it: joules of each arm, and of two arms the factor."""
    known = [arm for arm, spent in now.arms.items() if spent.total_j is not None]
    told = [f"{names[arm]} {_from_to(before.arms[arm].total_j, now.arms[arm].total_j)}" for arm in known]
    if not told:
        return ""
    line = f"At these prices: {', '.join(told[:_MOST_ARMS])}"
    if len(now.against) == len(before.against) == 1:
        line += f"; now {factor_text(now.against[0].factor)} times, was {factor_text(before.against[0].factor)}"
    return line


def _from_to(was_j: Joules, now_j: Joules) -> str:
    """`8.17 to 10.51 kJ`, `883.1 J to 1.2 kJ`."""
    was, now = joules_text(was_j), joules_text(now_j)
    return f"{was.split()[0] if was.split()[1:] == now.split()[1:] else was} to {now}"


def _compared(scenario: Scenario) -> Iterator[str]:
    yield f"{scenario.name}, seed {scenario.seed}: {len(scenario.agents)} robots, {len(scenario.clusters)} tasks"
    ways: dict[str, list[str]] = {}
    for name in scenario.method_names:
        ways.setdefault(way_words(scenario, name), []).append(method_label(scenario, name))
    for way, who in ways.items():
        yield f"{', '.join(who)}: {way}"


def _learned(found: Answer, names: Mapping[str, str]) -> str:
    arms = list(found.arms.items())
    if len(arms) > _MOST_ARMS:
        done = sum(spent.has_learned for _, spent in arms)
        return f"all {_tasks(arms[0][1].tasks)} by {done} of {len(arms)} arms"
    everybody = len(arms) > 1 and all(spent.has_learned for _, spent in arms)
    told = []
    for arm, spent in arms:
        tasks = "" if everybody else f"{spent.learned} of {_tasks(spent.tasks)} "
        shot = f" ({_tasks(spent.zero_shot)} in none)" if spent.zero_shot else ""
        after = f" after {spent.t0} in the data center" if spent.t0 else ""
        told.append(f"{names[arm]} {tasks}in {spent.rounds:g} rounds{shot}{after}")
    start = f"all {_tasks(arms[0][1].tasks)} by {'both' if len(arms) == 2 else 'all'}: " if everybody else ""
    return start + "; ".join(told)


def _path_errors(found: Answer, names: Mapping[str, str]) -> Iterator[str]:
    """What R does not tell: how far off their paths robots are at the end."""
    known = [(each.arm, each.rmse_m, each.worst_rmse_m) for each in found.arms.values()]
    told = [(names[arm], mean, worst) for arm, mean, worst in known if mean is not None and worst is not None]
    if len(told) > _MOST_ARMS:
        yield f"RMSE at the end at most {max(worst for _, _, worst in told):.2f} m, of the worst task of all arms"
    elif told:
        each = [f"{name} {mean:.2f} m (worst task {worst:.2f} m)" for name, mean, worst in told]
        yield f"RMSE at the end: {'; '.join(each)}"


def _tasks(count: int) -> str:
    return f"{count} task" if count == 1 else f"{count} tasks"


def _why(scenario: Scenario, found: Answer, names: Mapping[str, str]) -> Iterator[str]:
    """The largest part of what the dearest arm has spent."""
    known = [each for each in found.arms.values() if each.largest]
    dearest = max(known, key=lambda each: each.total_j or 0.0, default=None)
    if dearest is not None and dearest.largest is not None:
        cause, share = dearest.largest
        yield f"{share:.0%} of what {names[dearest.arm]} costs is {cause_words(scenario, dearest.arm, cause)}"


def _turns(found: Answer, energy: Energy, names: Mapping[str, str]) -> Iterator[str]:
    """What would turn the verdict on the arm that comes nearest to the one that it is held against."""
    if not found.against:
        return
    one = min(found.against, key=lambda each: abs(math.log(each.factor)))
    told, never = [], []
    if one.has_stage and one.pays_from_tasks is None:
        never.append("more tasks")
    elif one.has_stage and one.pays_from_tasks is not None:
        least, here = math.floor(one.pays_from_tasks) + 1, found.arms[one.arm].tasks
        if one.factor > 1:
            told.append(f"there were {least:,} tasks or more (here {here})")
        elif least > 1:
            told.append(f"there were fewer than {least:,} tasks (here {here})")
    for constant, symbol in _SYMBOLS.items():
        now, there = getattr(energy, constant) / 1e3, one.turns_at.get(constant)
        if there is None:
            never.append(f"any {symbol}")
        else:
            way = "below" if there / 1e3 < now else "above"
            told.append(f"{symbol} were {way} {there / 1e3:,.4g} kb/J (here {now:,.4g})")
    where = f"{names[one.arm]}: " if len(found.against) > 1 else ""
    by = f"not by {', '.join(never)}"
    if not told:
        yield f"{where}never: {by}"
    else:
        yield where + ", or ".join(told) + (f"; {by}" if never else "")


def _other_prices(run: Run, energy: Energy, found: Answer) -> Iterator[str]:
    """Other ways to price the same: those that agree as one."""
    held = {arm: columns(run, arm, energy) for arm in found.arms}  # all, so that a list that fails is told
    if not found.against:
        return
    one = min(found.against, key=lambda each: abs(math.log(each.factor)))
    agree, differ = [], []
    for mine, plain in zip(held[one.arm], held[one.other], strict=True):
        mine_j, plain_j = mine.joules["total"], plain.joules["total"]
        if mine.label == COUNTED or not mine_j or not plain_j:
            continue
        factor = mine_j / plain_j
        if abs(factor / one.factor - 1) <= _AGREE:
            agree.append(mine.label)
        else:
            differ.append(f"{factor_text(factor)} times by {mine.label}")
    told = [f"the same within {_AGREE:.0%} by {' and '.join(agree)}"] if agree else []
    if told or differ:
        yield "; ".join([*told, *differ])
