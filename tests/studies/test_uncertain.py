"""Ranges in a study by hand, and a bill of no width."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.literal import literal
from jouleswarm.studies.prices import with_motions
from jouleswarm.studies.run import reprice
from jouleswarm.studies.uncertain import uncertain_rows
from tests.studies.made_up import pair_of_arms
from tests.studies.test_outputs import rows_of


def test_zero_width_is_the_bill_of_today_to_the_digit(paper_results: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    reprice(paper_results, ["energy.ul_bit_per_j={low=200e3,high=200e3}"], out, kinds=())
    for arm, t0 in (("fl", "0"), ("maml-t90", "90"), ("maml", "240")):
        (row,) = rows_of(out / "uncertain.csv", arm=arm)
        (energy,) = rows_of(out / "energy.csv", ul_kb_per_j="200", prices="literal", t0=t0)
        names = ("total_j", "prices_mean_j", "prices_low95_j", "prices_high95_j")
        assert {row[name] for name in names} == {energy["total_j"]}
    assert "ul_bit_per_j 200000 to 200000" in (out / "uncertain.md").read_text()


def test_a_range_of_the_uplink_has_the_mean_of_its_inverse(scenario: Scenario) -> None:
    energy = Energy.model_validate({"ul_bit_per_j": {"low": 100e3, "high": 400e3}})
    facts = with_motions([fact for seed in (1, 2) for fact in pair_of_arms("", seed, 10, 20)], scenario)
    with_it, without = uncertain_rows(facts, energy, [literal])
    # E[1 / E_UL] = ln(b / a) / (b - a) of the bits up and down; two seeds that are alike have no spread of their own.
    rest_j = 42 * 1182.36 + 81 * 260.8
    bits = 8 * (42 * 73.8e6 + 12 * 5.6e6)
    assert with_it.by_prices.mean == pytest.approx(rest_j + bits * math.log(4) / 300e3, rel=1e-4)
    assert with_it.nominal_j == pytest.approx(rest_j + bits / 250e3)
    assert with_it.by_both == pytest.approx(with_it.by_prices)
    assert (with_it.pays, without.pays) == (0.0, None)


def test_seeds_are_drawn_again_besides(scenario: Scenario) -> None:
    energy = Energy.model_validate({"pue": {"low": 1.67, "high": 1.67}})
    facts = with_motions([fact for seed in (1, 2) for fact in pair_of_arms("", seed, 10, 10 * seed)], scenario)
    _, without = uncertain_rows(facts, energy, [literal])
    # 81 rounds by one seed, 141 by the other; a quarter of the draws has the first twice, a quarter the second.
    assert without.by_both[1:] == pytest.approx((81 * 260.8, 141 * 260.8))
    assert without.nominal_j == pytest.approx(111 * 260.8)


def test_how_likely_transfer_pays_is_counted_in_draws(scenario: Scenario) -> None:
    # The stage without computing and traffic: with it a seed saves 60 rounds, or costs 6 more.
    free = {"gradients_support": 0, "gradients_query": 0, "uplink_bytes": 0, "downlink_bytes": 0}
    facts = [
        fact if fact.task else fact.model_copy(update=free)
        for seed, without in ((1, 20), (2, 9))
        for fact in pair_of_arms("", seed, 10, without)
    ]
    energy = Energy.model_validate({"pue": {"low": 1.5, "high": 2.0}})
    with_it, _ = uncertain_rows(with_motions(facts, scenario), energy, [literal])
    assert with_it.pays == pytest.approx(0.75, abs=0.06)  # all but the draws that have seed 2 twice


def test_an_arm_of_fewer_seeds_is_held_against_the_same_seeds_without_transfer(scenario: Scenario) -> None:
    free = {"gradients_support": 0, "gradients_query": 0, "uplink_bytes": 0, "downlink_bytes": 0}
    # Without transfer seed 1 takes 5 rounds a task, fewer than the 10 with it; seed 2 takes so many that a mean of both
    # is dearer than them.
    facts = [
        fact if fact.task else fact.model_copy(update=free)
        for seed, without in ((1, 5), (2, 100))
        for fact in pair_of_arms("", seed, 10, without)
        if fact.arm == "fl" or seed == 1
    ]
    energy = Energy.model_validate({"pue": {"low": 1.5, "high": 2.0}})
    with_it, _ = uncertain_rows(with_motions(facts, scenario), energy, [literal])
    assert with_it.pays == 0.0
    (alone,) = uncertain_rows(with_motions([fact for fact in facts if fact.arm == "maml"], scenario), energy, [literal])
    assert alone.pays is None


def test_exact_constants_have_no_table(scenario: Scenario) -> None:
    assert uncertain_rows(with_motions(pair_of_arms("", 1, 10, 20), scenario), Energy(), [literal]) == []
