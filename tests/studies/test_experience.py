"""The study of experience: which deployments, and what each choice is worth."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.studies.catalogue import kind_of
from jouleswarm.studies.engine import FACTS
from jouleswarm.studies.experience import worth_csv
from jouleswarm.studies.facts import write_facts
from jouleswarm.studies.jobs import Request
from jouleswarm.studies.record import Record, write_record
from jouleswarm.studies.run import make_tables
from tests.studies.made_up import pair_of_arms

ROOT = Path(__file__).parents[2]


def planned(*overrides: str, file: str = "quick") -> dict[str, Scenario]:
    request = Request(ROOT / "scenarios" / f"{file}.toml", overrides, (1,), 90)
    return {job.variant: job.load() for job in kind_of("experience").plan(request).jobs}


def rule(scenario: Scenario) -> tuple[str, float, str, float, str]:
    learning = scenario.learning
    return learning.collect, learning.epsilon, learning.starts, scenario.meta_epsilon, scenario.meta_starts


ONE_RULE = ("learning.collect=guide", "learning.epsilon=0.1", "learning.starts=anywhere")


def test_each_point_is_one_change_of_the_rule_and_what_is_alike_is_run_once() -> None:
    assert {label: rule(each) for label, each in planned(*ONE_RULE).items()} == {
        "base": ("guide", 0.1, "anywhere", 0.1, "anywhere"),
        "policy=own": ("own", 0.1, "anywhere", 0.1, "anywhere"),
        "policy=unguided": ("own", 0.1, "anywhere", 1.0, "anywhere"),
        "epsilon=0.3": ("guide", 0.3, "anywhere", 0.3, "anywhere"),
        "epsilon=0.6": ("guide", 0.6, "anywhere", 0.6, "anywhere"),
        "starts=area": ("guide", 0.1, "area", 0.1, "area"),
        "starts=entry": ("guide", 0.1, "entry", 0.1, "entry"),
        "before=before": ("own", 0.1, "area", 0.6, "anywhere"),
    }  # and all robots as the data center's before: epsilon=0.6


def test_a_scenario_whose_data_center_has_its_own_rule_is_varied_as_a_whole() -> None:
    found = planned(*ONE_RULE, "meta.epsilon=0.5", 'meta.starts="entry"')
    assert rule(found["base"]) == ("guide", 0.1, "anywhere", 0.5, "entry")
    assert rule(found["epsilon=0.3"]) == ("guide", 0.3, "anywhere", 0.3, "entry")
    assert rule(found["starts=area"]) == ("guide", 0.1, "area", 0.5, "area")
    assert rule(found["before=guided"]) == ("guide", 0.6, "anywhere", 0.6, "anywhere")


def test_what_a_choice_is_worth_is_rounds_without_over_rounds_with_transfer() -> None:
    # Made up: a task of number n takes 10 + n rounds without and 3 + n with: 6 x 10 + 21 = 81 and 6 x 3 + 21 = 39.
    facts = [*pair_of_arms("base", 1, 3, 10), *pair_of_arms("base", 2, 3, 10), *pair_of_arms("policy=own", 1, 10, 3)]
    table = worth_csv(facts, {"policy": {"guide": "base", "own": "policy=own", "unguided": "policy=unguided"}})
    one, other = (dict(zip(table.headings, row, strict=True)) for row in table.rows)
    assert (one["value"], one["without"], one["with"], one["seeds"], one["trials"]) == ("guide", 81, 39, 2, 12)
    assert one["gain"] == pytest.approx(81 / 39)
    assert one["gain_ci95"] == pytest.approx(0, abs=1e-9)  # both seeds alike
    assert (other["value"], other["without"], other["with"], other["gain_ci95"]) == ("own", 39, 81, None)


def test_where_nothing_took_a_round_there_is_no_gain() -> None:
    facts = [
        each.model_copy(update={"rounds": 0}) if each.task and each.t0 else each for each in pair_of_arms("b", 1, 3, 3)
    ]
    (row,) = worth_csv(facts, {"policy": {"guide": "b"}}).rows
    assert dict(zip(worth_csv(facts, {}).headings, row, strict=True))["gain"] is None


def test_the_study_makes_a_table_and_a_figure_of_each_choice(tmp_path: Path, scenario: Scenario) -> None:
    facts = [each for variant in ("base", "policy=own") for each in pair_of_arms(variant, 1, 3, 10)]
    write_facts(tmp_path / FACTS, facts)
    groups = {"policy": {"guide": "base", "own": "policy=own"}}
    write_record(
        tmp_path, Record(study="experience", profile="compact", scenario=scenario, seeds=(1,), t0=90, groups=groups)
    )
    make_tables(tmp_path, ["svg"])
    with (tmp_path / "worth.csv").open(newline="") as file:
        assert [row["variant"] for row in csv.DictReader(file)] == ["base", "policy=own"]
    assert {path.name for path in tmp_path.iterdir()} >= {"experience.csv", "experience.md", "experience_policy.svg"}
