"""Figures worked out by hand, from the rows of an earlier `study paper` (`audited`) and from committed ones."""

from __future__ import annotations

import csv
from pathlib import Path
from statistics import fmean

import pytest

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.bill import CAUSES
from jouleswarm.energy.breakeven import Savings, returns_to_pay, tasks_to_pay
from jouleswarm.energy.curves import curve
from jouleswarm.energy.facts import Counts, Facts, Phase
from jouleswarm.energy.literal import literal, price
from jouleswarm.studies.arms import by_full_window, rounds_estimate
from jouleswarm.studies.breakeven import compared
from jouleswarm.studies.columns import cause_columns
from jouleswarm.studies.facts import META_STAGE, Fact, read_facts
from jouleswarm.studies.prices import cost_of, moved_motions, runs_of, with_motions
from jouleswarm.studies.record import read_record

RESULTS = Path(__file__).parents[2] / "results"
AUDITED = Path(__file__).parent / "audited"
SEEN = (1, 2, 6)


@pytest.fixture(scope="module")
def compact() -> list[Fact]:
    return read_facts(AUDITED / "facts.csv")


def _savings(facts: list[Fact], energy: Energy, t0: int = 90) -> Savings:
    def mean(t0: int, seen: bool) -> float:
        mine = [fact for fact in facts if fact.t0 == t0 and fact.task != META_STAGE and (fact.task in SEEN) == seen]
        return fmean(price(fact.counts, energy).total_j for fact in mine)

    stage = [price(fact.counts, energy) for fact in facts if (fact.t0, fact.task) == (t0, META_STAGE)]
    down = fmean(cost.downlink_j for cost in stage) / 6
    saved = [mean(0, seen) - mean(t0, seen) - down for seen in (True, False)]
    return Savings(fmean(cost.total_j - cost.downlink_j for cost in stage), *saved, len(SEEN))


@pytest.mark.parametrize(("ul", "sl", "tasks"), [(200e3, 500e3, 1188.8), (500e3, 200e3, 471.1), (1e15, 1e15, 357.1)])
def test_break_even_counts_seen_tasks_once(compact: list[Fact], ul: float, sl: float, tasks: float) -> None:
    energy = Energy(ul_bit_per_j=ul, sl_bit_per_j=sl)
    assert tasks_to_pay(_savings(compact, energy)) == pytest.approx(tasks, rel=1e-4)


def test_returns_of_a_seen_task(compact: list[Fact]) -> None:
    savings = _savings(compact, Energy())
    assert savings.seen_j == pytest.approx(1462, rel=1e-4)
    assert returns_to_pay(savings) == pytest.approx(254, rel=2e-3)


def test_what_had_been_learned_after_so_many_rounds(compact: list[Fact]) -> None:
    mine = {fact.task: fact for fact in compact if (fact.arm, fact.seed) == ("fl", 1)}
    parts: dict[tuple[Phase, int], Counts] = {("fl", task): fact.counts for task, fact in mine.items()}
    facts = Facts("fl", "fl", 0, parts, {task: fact.rounds for task, fact in mine.items()})
    learned = {task: fact.learned for task, fact in mine.items()}
    points = list(curve(facts, learned))
    spent = [literal.price(point.facts, Energy()).total_j for point in points]
    assert spent[1] / 6 == pytest.approx(100.866, rel=1e-5)  # a cluster's round
    assert spent[-1] == pytest.approx(8170.1, rel=1e-5)  # 81 of them
    assert [len(points[round_].learned) for round_ in (7, 8, 12, 18, 19)] == [0, 1, 3, 5, 6]


def test_motions_of_transfer_and_what_they_cost(compact: list[Fact]) -> None:
    # t_i x 2 robots x 20 motions, and t0 x 3 training robots x 20: 90 x 60 + 39.67 x 40 against 95.27 x 40.
    scenario = read_record(AUDITED).scenario
    facts = with_motions(compact, scenario)
    told = {}
    for arm in ("multitask-t90", "fl"):
        runs = runs_of(facts, "", arm).values()
        free, priced = (
            fmean(cost_of(run, energy).total_j for run in runs) for energy in (Energy(), Energy(motion_j=10))
        )
        told[arm] = fmean(map(moved_motions, runs)), priced - free
    assert [round(motions) for motions, _ in told.values()] == [6987, 3811]
    assert round(told["multitask-t90"][0] / told["fl"][0], 2) == 1.83
    assert [round(joules / 1e3, 1) for _, joules in told.values()] == [69.9, 38.1]


def test_evaluation_that_nobody_counted_is_not_free(compact: list[Fact]) -> None:
    energy = Energy(motion_j=10, forward_j=1)
    acting, evaluating = cause_columns(energy, [cause for cause in CAUSES if cause.key in ("acting", "evaluating")])
    assert evaluating.over(compact, "", "fl") is None
    counted = [fact.model_copy(update={"motions": 3.0, "evaluation_motions": 2.0}) for fact in compact]
    told = [column.over(counted, "", "fl") for column in (acting, evaluating)]
    assert [each and each.mean for each in told] == pytest.approx([6 * 3 * 10, 6 * 2 * 11])


def test_rounds_by_the_full_window(compact: list[Fact]) -> None:
    def ratio(facts: list[Fact]) -> float:
        without, with_it = (rounds_estimate(facts, arm, range(1, 7)).mean for arm in ("fl", "multitask-t90"))
        return round(without / with_it, 2)

    assert (ratio(compact), ratio(by_full_window(compact, 5))) == (2.40, 1.92)


def test_break_even_of_the_mean_facts_with_a_free_radio(compact: list[Fact]) -> None:
    each = compared(compact, "multitask-t90", "fl", SEEN)
    found = each.means(Energy(ul_bit_per_j=1e15, sl_bit_per_j=1e15))
    assert found is not None
    assert tasks_to_pay(found) == pytest.approx(357.1, rel=1e-4)


def test_exact_meta_gradients_at_the_measured_beta() -> None:
    # 90 rounds of 30 + beta 30 batches of 19.706 J; beta of seed 1: 2.7926 of one inner step, 1.6294 of the last layer.
    facts = read_facts(RESULTS / "compact-baselines" / "facts.csv")
    energy = read_record(RESULTS / "compact-baselines").scenario.energy
    for arm, beta in (("maml", 2.79258), ("anil", 1.62938), ("fomaml", 1.0)):
        cost = cost_of(runs_of(facts, "", arm)[1], energy)
        assert cost.computing_datacenter_j == pytest.approx(90 * 30 * (1 + beta) * 19.706, rel=1e-5)


def test_shares_of_the_bill_with_transfer() -> None:
    # 90 rounds of 60 batches of 19.706 J; 22 rounds of two robots, 20 batches of 2.04 J each
    facts = read_facts(RESULTS / "compact-regimes" / "facts.csv")
    mine = [fact.counts for fact in facts if (fact.variant, fact.arm, fact.seed) == ("base", "reptile", 1)]
    cost = price(sum(mine, Counts()), Energy())
    shares = [round(100 * joules / cost.total_j, 2) for joules in list(cost.by_cause.values())[:5]]
    assert (cost.computing_datacenter_j, cost.computing_robots_j) == (pytest.approx(106412.4), pytest.approx(1795.2))
    assert shares == [28.42, 0.48, 70.91, 0.08, 0.11]  # computing there, computing on robots, up, down, sidelinks


def _by_seed(method: str, tasks: tuple[int, ...]) -> dict[str, int]:
    """Rounds by seed, without transfer or at t0 = 90, read without any code of ours."""
    found: dict[str, int] = {}
    with (RESULTS / "compact" / "facts.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            if row["method"] == method and row["t0"] in ("0", "90") and int(row["task"]) in tasks:
                found[row["seed"]] = found.get(row["seed"], 0) + int(row["rounds"])
    return found


def test_rounds_that_transfer_takes_by_a_plain_sum_over_the_committed_rows() -> None:
    methods, unseen, seen = ("fl", "maml", "fomaml", "reptile"), (3, 4, 5), SEEN
    rounds = {(method, tasks): _by_seed(method, tasks) for method in methods for tasks in (unseen, seen)}
    first = {key: sum(held[str(seed)] for seed in range(1, 16)) for key, held in rounds.items()}
    assert [first[method, unseen] for method in methods] == [506, 668, 480, 518]
    assert [first[method, seen] for method in methods] == [789, 486, 197, 0]
    whole = {key: sum(held.values()) for key, held in rounds.items()}  # 25 seeds
    assert [whole[method, unseen] for method in methods] == [815, 1006, 776, 785]
    assert [whole[method, seen] for method in methods] == [1308, 757, 329, 42]
    with (RESULTS / "compact" / "seen_unseen.csv").open(newline="") as file:
        table = {(row["method"], row["tasks"]): float(row["full_window"]) for row in csv.DictReader(file)
                 if row["measure"] == "rounds" and row["t0"] in ("0", "90")}  # fmt: skip
    for method in methods:
        told = [table[method, tasks] for tasks in ("unseen", "seen")]
        assert told == pytest.approx([whole[method, tasks] / 25 for tasks in (unseen, seen)], rel=1e-4)


def test_the_bill_of_exact_maml_by_hand() -> None:
    # Seed 1, stopped at t0 = 42: 1260 + 1260 gradients (beta = 1) of 1.67 * 590 W * 0.02 s = 19.706 J;
    # 3,097,624,320 bytes up and 7,223,424 down at 200 kb/J; then 71 rounds of two robots, each with 20 gradients
    # of 5.1 W * 0.4 s = 2.04 J and 602,048 bytes to its neighbour at 500 kb/J.
    stage = 2520 * 19.706 + 8 * (3_097_624_320 + 7_223_424) / 200e3
    rounds = 71 * 2 * (20 * 2.04 + 8 * 602_048 / 500e3)
    held = [fact for fact in read_facts(RESULTS / "compact" / "facts.csv") if (fact.arm, fact.seed) == ("maml-t42", 1)]
    energy = read_record(RESULTS / "compact").scenario.energy
    assert cost_of(held, energy).total_j == pytest.approx(stage + rounds, rel=1e-9)
