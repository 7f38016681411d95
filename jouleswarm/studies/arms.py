"""The arms of a study's facts in the order that tables and figures show them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import fmean
from typing import Literal, NamedTuple

from jouleswarm.common.doors import SHIPPED
from jouleswarm.common.scenario.arms import arm_name, method_of
from jouleswarm.methods.consensus import BASELINE
from jouleswarm.studies.estimates import Estimate, estimate
from jouleswarm.studies.facts import META_STAGE, Fact
from jouleswarm.studies.prices import failures, runs_of, task_stages

Measure = Literal["rounds", "rounds_first", "rounds_w3"]
MEASURES: tuple[Measure, ...] = ("rounds", "rounds_first", "rounds_w3")
PLAIN = BASELINE
"""The arm without transfer."""


class ArmOf(NamedTuple):
    """An arm of one variant of a study."""

    variant: str
    arm: str
    t0: int


def arms_by_variant(facts: Iterable[Fact]) -> dict[str, list[ArmOf]]:
    """Variants in the order of the facts, in each its arms, those of the smallest t0 first."""
    found: dict[str, list[ArmOf]] = {}
    for arm in dict.fromkeys(ArmOf(fact.variant, fact.arm, fact.t0) for fact in facts):
        found.setdefault(arm.variant, []).append(arm)
    return {variant: sorted(arms, key=lambda arm: arm.t0) for variant, arms in found.items()}


def names_of(arms: Iterable[ArmOf]) -> dict[ArmOf, str]:
    """Names of a variant's arms: `without` or `t0 = 42` where that tells them apart; `maml, t0 = 42` where a method
    has several t0; else their own."""
    held = list(arms)
    apart = len({arm.t0 for arm in held}) == len(held) and all(arm.t0 or arm.arm == PLAIN for arm in held)
    if apart:
        return {arm: f"t0 = {arm.t0}" if arm.t0 else "without" for arm in held}
    several = len({method_of(arm.arm) for arm in held}) < len({arm.arm for arm in held})
    return {arm: f"{method_of(arm.arm)}, t0 = {arm.t0}" if several and arm.t0 else arm.arm for arm in held}


def told_apart(facts: Sequence[Fact]) -> list[Fact]:
    """Facts with arms that each have one t0: one that has several, as some seeds went further, is named by them."""
    found: dict[tuple[str, str], set[int]] = {}
    for fact in facts:
        found.setdefault((fact.variant, fact.arm), set()).add(fact.t0)
    several = {key for key, held in found.items() if len(held) > 1}
    return [
        fact.model_copy(update={"arm": arm_name(fact.method, fact.t0)}) if (fact.variant, fact.arm) in several else fact
        for fact in facts
    ]


class Line(NamedTuple):
    """An arm as the paper's tables have it: learning without transfer, or a method at a t0."""

    method: str
    t0: int
    arm: str


def lines_of(facts: Iterable[Fact]) -> list[Line]:
    """Learning without transfer, then method by method (MAML, the paper's own, first), the smallest t0 first; methods
    with no stage are left out."""
    found = {Line(fact.method, fact.t0, fact.arm): None for fact in facts if fact.t0 or fact.arm == PLAIN}
    order = list(dict.fromkeys([PLAIN, *SHIPPED["methods"], *(line.method for line in found)]))
    return sorted(found, key=lambda line: (order.index(line.method), line.t0))


def series_of(facts: Sequence[Fact]) -> dict[str, list[Fact]]:
    """Method -> its facts and those without transfer, in the order of `lines_of`; without methods these alone."""
    methods = dict.fromkeys(line.method for line in lines_of(facts) if line.t0) or {PLAIN: None}
    return {method: [fact for fact in facts if fact.method == method or fact.arm == PLAIN] for method in methods}


def arms_by_t0(facts: Iterable[Fact]) -> dict[int, str]:
    """t0 -> arm of one series, 0 for learning without transfer, the smallest first. Other methods are left out."""
    found = {fact.t0: fact.arm for fact in facts if fact.t0 or fact.arm == PLAIN}
    return dict(sorted(found.items()))


Groups = dict[str, tuple[int, ...]]
"""Name of a group of tasks -> their ids."""


def groups_of(facts: Iterable[Fact], training: Iterable[int]) -> Groups:
    """Tasks that meta-training has not seen, those that it has, and all; without the groups that are empty."""
    tasks, seen = tasks_of(facts), set(training)
    groups = {
        "unseen": tuple(task for task in tasks if task not in seen),
        "seen": tuple(task for task in tasks if task in seen),
        "all": tasks,
    }
    return {name: of for name, of in groups.items() if of}


def tasks_of(facts: Iterable[Fact]) -> tuple[int, ...]:
    """Ids of the tasks, ascending."""
    return tuple(sorted({fact.task for fact in task_stages(facts)}))


def rounds_estimate(facts: Sequence[Fact], arm: str, tasks: Iterable[int], measure: Measure = "rounds") -> Estimate:
    """Rounds of an arm summed over `tasks`, over seeds."""
    wanted, runs = set(tasks), runs_of(facts, "", arm).values()
    return estimate(sum(getattr(fact, measure) for fact in task_stages(run) if fact.task in wanted) for run in runs)


def by_full_window(facts: Iterable[Fact], window: int) -> list[Fact]:
    """The facts with t_i by the full window: R of fewer rounds than `window` says nothing, so a task takes as many.

    Where robots stopped on a part of the window that is the least it can be; what was learned by round 0 stays so.
    """

    def rounds(fact: Fact) -> int:
        return max(fact.rounds, window) if fact.task != META_STAGE and fact.learned and fact.rounds else fact.rounds

    return [fact.model_copy(update={"rounds": rounds(fact)}) for fact in facts]


def failures_of(facts: Iterable[Fact], variant: str, arm: str, tasks: Iterable[int] | None = None) -> tuple[int, int]:
    """(not learned, all) trials of an arm on `tasks` (default: on all), all seeds together."""
    wanted = None if tasks is None else set(tasks)
    held = [fact for fact in task_stages(facts) if (fact.variant, fact.arm) == (variant, arm)]
    held = [fact for fact in held if wanted is None or fact.task in wanted]
    return failures(held), len(held)


def ran_away_note(facts: Iterable[Fact]) -> str | None:
    """Which arms had robots whose values were no estimate of a return, and in how many tasks; None where none had."""
    held: dict[tuple[str, str], list[Fact]] = {}
    for fact in task_stages(facts):
        held.setdefault((fact.variant, fact.arm), []).append(fact)
    told = [
        f"{arm}{f' with {variant}' if variant else ''} in {away} of {len(each)}"
        for (variant, arm), each in held.items()
        if (away := sum(fact.ran_away > 0 for fact in each))
    ]
    where = "their rounds tell of this, and not of the method"
    return f"Values ran away, beyond any return, in tasks of {'; '.join(told)}: {where}." if told else None


class PathError(NamedTuple):
    """RMSE at the stop in metres, of each task the mean over its robots."""

    mean_m: float
    worst_m: float


def path_error(facts: Iterable[Fact], variant: str, arm: str, tasks: Iterable[int] | None = None) -> PathError | None:
    """How far off the path an arm was when it stopped, over `tasks` (default: all) and seeds, not learned ones too.

    None where no fact tells: environments without a path.
    """
    wanted = None if tasks is None else set(tasks)
    held = [fact for fact in task_stages(facts) if (fact.variant, fact.arm) == (variant, arm)]
    errors_m = [fact.rmse_m for fact in held if fact.rmse_m is not None and (wanted is None or fact.task in wanted)]
    return PathError(fmean(errors_m), max(errors_m)) if errors_m else None


def zero_shot_share(facts: Iterable[Fact]) -> float | None:
    """Share of tasks that were learned before their first round; None where robots did not try before it, as in facts
    from before evaluation's motions were noted."""
    held = task_stages(facts)
    if not held or any(fact.evaluation_motions is None for fact in held):
        return None
    return fmean(fact.learned and not fact.rounds for fact in held)


def copied_share(facts: Iterable[Fact]) -> float | None:
    """Share of tasks whose R reached the target in round 0 or 1, so before there was much to learn; None of none."""
    held = task_stages(facts)
    return fmean(fact.learned and fact.rounds_first <= 1 for fact in held) if held else None
