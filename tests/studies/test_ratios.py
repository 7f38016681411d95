"""What transfer gains, and the verdict, from made-up facts."""

from __future__ import annotations

import pytest

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.breakeven import Kind, tasks_for
from jouleswarm.energy.literal import literal
from jouleswarm.studies.arms import lines_of, series_of
from jouleswarm.studies.beta import BETA_1, with_beta_1
from jouleswarm.studies.curves import curves_of
from jouleswarm.studies.curves_figures import by_method
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.families import Finding, findings, findings_csv, findings_markdown
from jouleswarm.studies.prices import PRICE_LISTS, of_tasks, priced
from jouleswarm.studies.ratio_figures import methods_figure, ratios_figure
from jouleswarm.studies.ratio_tables import ratios_csv, ratios_markdown
from jouleswarm.studies.ratios import FIRST, FULL, Row, Told, ratio_rows
from jouleswarm.studies.significance import Between, Ratios
from jouleswarm.studies.verdict import answers, verdict_csv, verdict_markdown
from tests.studies.made_up import meta_fact, task_fact

PLAIN, SEEN = Arm("fl", "fl", 0), (1,)


def facts_of_two_methods() -> list[Fact]:
    """Task 1 is seen and 2 is not; two seeds; t0 of 42 and 90 each, without 20 + seed and 40 + seed rounds."""
    facts = [task_fact(PLAIN, task, 20 * task + seed, seed) for seed in (1, 2) for task in (1, 2)]
    for method, factor in (("multitask", 1), ("maml", 2)):
        for t0 in (42, 90):
            arm = Arm(method if t0 == 90 else f"{method}-t{t0}", method, t0)
            for seed in (1, 2):
                rounds = {1: 1, 2: 10 * factor}
                facts.append(meta_fact(arm, seed, robots=4, downlink_bytes=4 * 5_600_000))
                facts += [task_fact(arm, task, each, seed, rounds_first=each) for task, each in rounds.items()]
    return facts


def test_lines_are_mamls_first_and_each_method_has_a_series_of_its_own() -> None:
    facts = facts_of_two_methods()
    assert [(line.method, line.t0) for line in lines_of(facts)] == [
        ("fl", 0), ("maml", 42), ("maml", 90), ("multitask", 42), ("multitask", 90),
    ]  # fmt: skip
    assert {name: len(held) for name, held in series_of(facts).items()} == {"maml": 16, "multitask": 16}


def test_ratios_are_of_unseen_tasks_first_with_what_was_copied() -> None:
    rows = ratio_rows(facts_of_two_methods(), SEEN, 5, Energy(), PRICE_LISTS)
    assert list(dict.fromkeys(row.tasks for row in rows)) == ["unseen", "seen", "all"]
    unseen = next(row for row in rows if (row.tasks, row.measure, row.method, row.t0) == ("unseen", FULL, "maml", 90))
    assert (unseen.without, unseen.with_) == (41.5, 20)
    assert unseen.gain.of_means.value == pytest.approx(41.5 / 20)
    assert (unseen.p, unseen.p_holm, unseen.mine.copied) == (0.5, 1, 0)  # 2 of 4 ways; times four arms
    seen = next(row for row in rows if (row.tasks, row.measure, row.method, row.t0) == ("seen", FULL, "maml", 90))
    first = next(row for row in rows if (row.tasks, row.measure, row.method, row.t0) == ("seen", FIRST, "maml", 90))
    assert (seen.with_, first.with_, seen.mine.copied) == (5, 1, 1)  # the window's 5 rounds, and its first
    assert (seen.mine.rmse_mean_m, seen.mine.rmse_worst_m) == (0.5, 0.5)


def test_runs_that_were_cut_off_are_bounds() -> None:
    facts = [
        fact.model_copy(update={"learned": False}) if (fact.arm, fact.task, fact.seed) == ("fl", 2, 1) else fact
        for fact in facts_of_two_methods()
    ]
    table = ratios_markdown(ratio_rows(facts, SEEN, 5, Energy(), [literal]), {"unseen": (2,)})[0]
    assert list(table.rows[0][2:4]) == ["≥ 41.5", "20.0"]
    assert str(table.rows[0][4]).startswith("≥ 2.08")


def test_a_groups_bill_has_the_stage_whole_and_its_share_of_the_way_down() -> None:
    run = [fact for fact in facts_of_two_methods() if (fact.arm, fact.seed) == ("maml", 1)]
    bill = priced(of_tasks(run, (2,)), Energy(), literal)
    # 90 rounds of 60 gradients of 19.706 J and 73.8 MB up; 2 robots' 5.6 MB down; 20 rounds of 260.8 J.
    assert bill
    assert bill.total_j == pytest.approx(90 * (60 * 19.706 + 2952) + 448 + 20 * 260.8)


def test_the_equations_at_beta_1_stand_beside_a_measured_one() -> None:
    run = [meta_fact(Arm("maml", "maml", 42), beta=3.0), task_fact(Arm("maml", "maml", 42), 1, 10)]
    energy = Energy(beta="measured")
    dear, cheap = (priced(run, energy, prices) for prices in (literal, BETA_1))
    assert dear
    assert cheap
    assert dear.total_j - cheap.total_j == pytest.approx(42 * 30 * 2 * 19.706)
    assert with_beta_1([literal], energy) == (literal, BETA_1)
    assert with_beta_1([literal], Energy()) == (literal,)


def test_tasks_from_which_a_bill_is_cut_by_a_factor() -> None:
    # 100 + 3 x 10 + 2 (M - 3): half of 40 M at M = 3 + (200 - 3 x 20) / 36.
    kinds = [Kind(3, 40, 10), Kind(float("inf"), 40, 2)]
    assert tasks_for(2, 100, kinds) == pytest.approx(3 + 140 / 36)
    assert tasks_for(1, 60, kinds) == 2
    assert tasks_for(4, 100, [Kind(float("inf"), 40, 10)]) == float("inf")


def test_the_verdict_says_from_which_price_and_how_many_tasks_the_bill_is_halved() -> None:
    facts = facts_of_two_methods()
    found = {
        (each.tasks, each.method, each.t0, each.prices): each for each in answers(facts, SEEN, Energy(), PRICE_LISTS)
    }
    each = found["unseen", "multitask", 42, "literal"]
    stage, mine, plain = 42 * (60 * 19.706 + 2952), 448 + 10 * 260.8, 41.5 * 260.8
    assert each.ratio.value == pytest.approx(plain / (stage + mine))
    assert each.halves == "no"
    assert each.from_tasks == pytest.approx((2 * stage / (plain - 2 * mine), stage / (plain - mine)))
    # Free uplinks leave 42 x 60 gradients in the data center, and a whole bill without of 10.8 kJ.
    assert [verdict and verdict.where for verdict in each.ul] == ["never", "never"]
    published = found["seen", "multitask", 42, "published"]
    assert published.ratio.value == pytest.approx(21.5 * 246.3 / (42 * 352.4 + 246.3))
    assert published.ul == (None, None)
    cheap = Energy(t0_batch_s=1e-6)
    held = answers(facts, SEEN, cheap, [literal])
    far = next(each for each in held if each[:3] == ("all", "multitask", 42))
    joules, bits = 42 * 60 * 590e-6 * 1.67 + 11 * 260.8, 8 * (42 * 73.8e6 + 4 * 5.6e6 * 1)
    (half, _) = far.ul
    assert half
    assert half.where == "above"
    assert half.bit_per_j == pytest.approx(2 * bits / (63 * 260.8 - 2 * joules))


def test_tables_and_figures_tell_every_method(scenario: Scenario) -> None:
    facts = facts_of_two_methods()
    rows, found = ratio_rows(facts, SEEN, 5, Energy(), PRICE_LISTS), answers(facts, SEEN, Energy(), PRICE_LISTS)
    assert len(ratios_csv(rows).rows) == 3 * 4 * 4  # groups, measures, arms
    assert len(verdict_csv(found, Energy()).rows) == 3 * 2 * 4
    assert len(verdict_markdown(found, Energy()).rows) == 3 * 2 * 2
    unseen, seen = methods_figure(facts, scenario, SEEN).axes
    assert [axes.get_title() for axes in (unseen, seen)] == ["unseen tasks (2)", "seen tasks (1)"]
    assert len(ratios_figure(rows, scenario).axes) == 3
    assert list(by_method(curves_of(facts, scenario))) == ["", "-multitask"]


def with_p(t0: int, tasks: str, p: float, gain: float, measure: str = FULL) -> Row:
    told = Told(None, None, 0, 30, None, None)
    between = Between(gain, gain, gain)
    return Row("maml", t0, tasks, measure, 10, 10 * gain, 10.0, Ratios(between, between), p, None, told, told)


def test_p_is_corrected_within_each_of_two_families() -> None:
    rows = [
        with_p(42, "unseen", 0.01, 2.0),
        with_p(90, "unseen", 0.03, 2.0),
        with_p(90, "unseen", 0.02, 0.5),
        with_p(90, "unseen", 0.9, 0.001, FIRST),
        with_p(90, "seen", 0.004, 3.0),
        with_p(90, "all", 0.9, 0.001),
    ]
    found = [(each.family, each.row.tasks, each.row.t0, each.row.p_holm, each.saves) for each in findings(rows, 90)]
    # Of two primary ones 2 * 0.02 = 0.04, and 0.03, which may not fall below; of two others 2 * 0.004 and 0.01.
    assert found == [
        ("primary", "unseen", 90, 0.04, "yes"),
        ("primary", "unseen", 90, 0.04, "costs"),
        ("secondary", "unseen", 42, 0.01, "yes"),
        ("secondary", "seen", 90, 0.008, "yes"),
    ]
    assert findings(rows, 0) == []


@pytest.mark.parametrize(("p", "gain"), [(0.05, 2.0), (None, 2.0), (0.01, 1.0)])
def test_nothing_is_shown_by_a_p_of_the_level_or_more_or_by_no_gain(p: float, gain: float) -> None:
    assert Finding("primary", with_p(90, "unseen", p, gain)._replace(p_holm=p)).saves == "not shown"


def test_tests_are_a_table_for_programs_and_one_for_readers() -> None:
    found = findings([with_p(90, "unseen", 0.03, 2.0)], 90)
    table = findings_csv(found)
    assert dict(zip(table.headings, table.rows[0], strict=True)) == {
        "family": "primary", "method": "maml", "t0": 90, "tasks": "unseen", "seeds": 10, "without": 20, "with": 10,
        "ratio_of_means": 2, "ratio_of_means_low95": 2, "ratio_of_means_high95": 2, "p": 0.03, "p_holm": 0.03,
        "saves": "yes",
    }  # fmt: skip
    assert findings_markdown(found).rows[0][-2:] == ("0.03", "yes")
