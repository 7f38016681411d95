"""The tuner: what is drawn, what is run next, and that it goes on where it was stopped."""

from __future__ import annotations

import argparse
import csv
import itertools
import shutil
from pathlib import Path
from typing import Any

import pytest

from benchmarks import tuning
from benchmarks.tuning import Tuner, Unit, best_of, next_places
from benchmarks.tuning_ranges import METHODS, SEEDS, Between, OneOf, draw
from benchmarks.tuning_table import read_rows
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.studies.tuned import read_tuned

TOY = "scenarios/toy.toml"
COMMITTED = Path(__file__).parents[2] / "results" / "tuning"


def test_trials_are_the_same_every_time_and_the_first_is_the_scenario_as_it_stands() -> None:
    for tuned in METHODS:
        trials = draw(tuned, 8)
        assert trials == draw(tuned, 8)
        assert trials[0] == ()
        assert all(len(each) == len(tuned.ranges) for each in trials[1:])


def test_each_part_of_a_range_is_tried_equally_often() -> None:
    for tuned in METHODS:
        for index, values in enumerate(tuned.ranges.values()):
            found = [trial[index].partition("=")[2] for trial in draw(tuned, 9)[1:]]  # eight
            if isinstance(values, OneOf):
                assert {found.count(each) for each in found} == {8 // len(values.values)}
            else:
                edges = [values.low * (values.high / values.low) ** (part / 8) for part in range(9)]
                for (low, high), value in zip(itertools.pairwise(edges), sorted(map(float, found)), strict=True):
                    assert 0.95 * low <= value <= 1.05 * high  # two digits


def test_ranges_are_told_as_they_are() -> None:
    assert str(Between(3e-4, 3e-3)) == "0.0003 to 0.003, log-uniform"
    assert str(OneOf((0.0, 0.01, True))) == "0, 0.01, true"


def test_every_trial_of_every_method_is_a_scenario_that_can_be() -> None:
    for tuned in METHODS:
        for settings in draw(tuned, 8):
            load_scenario("scenarios/quick.toml", [f"methods=['{tuned.method}']", *tuned.fixed, *settings])


def test_all_trials_are_screened_on_two_seeds_before_the_best_quarter_is_run_on_all() -> None:
    seeds = (101, 102, 103)
    rounds = {(trial, 101): 50.0 + trial for trial in range(5)}
    assert next_places(5, seeds, rounds) == [(trial, 102) for trial in range(5)]
    rounds |= {(0, 102): 50.0, (1, 102): 60.0, (2, 102): 40.0, (3, 102): 90.0, (4, 102): 46.0}
    # means 50, 55.5, 46, 71.5, 50: a quarter of five is two, and of two alike the earlier goes on
    assert best_of(5, seeds, rounds) == [0, 2]
    assert next_places(5, seeds, rounds) == [(0, 103), (2, 103)]
    assert next_places(5, seeds, rounds | {(0, 103): 1.0}) == [(2, 103)]
    assert next_places(5, seeds, rounds | {(0, 103): 1.0, (2, 103): 2.0}) == []


def options(out: Path, **others: Any) -> argparse.Namespace:
    given = {"scenario": TOY, "trials": 2, "only": ["maml-shared"], "t0": 3, "max_rounds": 9, "workers": 1, "out": out}
    return argparse.Namespace(**given | others)


class Stopped(Exception):
    """Something ends the tuner."""


class Counted(Tuner):
    """Each unit takes as many rounds as its seed says, and a method's second trial fewer; ends before unit `ends`."""

    def __init__(self, given: argparse.Namespace, ends: int = 1000) -> None:
        super().__init__(given)
        self.run_units: list[Unit] = []
        self.ends = ends

    def _measure(self, unit: Unit) -> dict[str, float]:
        if len(self.run_units) == self.ends:
            raise Stopped
        self.run_units.append(unit)
        rounds = unit.seed - 90 * (unit.trial == 1)
        told = {"rounds": rounds, "rounds_first": 1, "not_learned": 0, "seen": 1, "unseen": rounds - 1, "cpu_s": 1.5}
        return {name: float(value) if name == "cpu_s" else value for name, value in told.items()}


def test_committed_tables_are_what_the_committed_trials_come_to(tmp_path: Path) -> None:
    shutil.copy(COMMITTED / "trials.csv", tmp_path)
    every = [each.name for each in METHODS]
    usual = {"scenario": "scenarios/quick.toml", "trials": 6, "only": every, "t0": 90, "max_rounds": 100}
    Tuner(options(tmp_path, **usual)).write()
    for name in ("trials.csv", "tuning.csv", "tuning.md", "best.toml"):
        assert (tmp_path / name).read_text() == (COMMITTED / name).read_text(), name


@pytest.fixture
def fits_the_toy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ranges without inner steps: the toy has four batches a round, and one training task."""
    names = {"meta.inner_lr", "meta.meta_lr", "learning.lr"}
    smaller = [
        tuning.Tuned(each.name, each.method, {k: v for k, v in each.ranges.items() if k in names}, each.fixed)
        for each in METHODS
    ]
    monkeypatch.setattr(tuning, "METHODS", tuple(smaller))


@pytest.mark.usefixtures("fits_the_toy")
def test_it_goes_on_where_it_was_stopped_and_runs_no_unit_twice(tmp_path: Path) -> None:
    first = Counted(options(tmp_path), ends=5)
    with pytest.raises(Stopped):
        first.run()
    second = Counted(options(tmp_path))
    second.run()
    units = [*first.run_units, *second.run_units]
    assert len(units) == len(set(units)) == 2 * (2 * 2 + 4)  # two methods: two trials on two seeds, one on four more
    assert Counted(options(tmp_path)).waiting() == []
    assert len(read_rows(tmp_path / "trials.csv")) == 16
    assert "| maml-shared |" in (tmp_path / "tuning.md").read_text()


@pytest.mark.usefixtures("fits_the_toy")
def test_the_best_robots_without_transfer_are_every_methods(tmp_path: Path) -> None:
    tuner = Counted(options(tmp_path))
    tuner.run()
    (robots,) = {unit.settings for unit in tuner.run_units if (unit.method, unit.trial) == ("fl", 1)}
    assert robots[0].startswith("learning.lr=")
    others = [unit for unit in tuner.run_units if unit.method == "maml-shared"]
    assert {unit.settings[: len(robots)] for unit in others} == {robots}

    assert {unit.settings[len(robots)] for unit in others} == {"meta.heads=shared"}
    fl, maml = tuner.outcomes()
    # seeds 101 to 106 less 90: 11 to 16 rounds
    assert [row.rounds for row in fl.best] == [seed - 90 for seed in SEEDS]
    assert (fl.units, fl.units_of, fl.cpu_s) == (8, 8, 12.0)
    assert [row.rounds for row in maml.default] == [101, 102]


@pytest.mark.usefixtures("fits_the_toy")
def test_another_scenarios_rows_are_kept_and_not_taken_for_these(tmp_path: Path) -> None:
    Counted(options(tmp_path)).run()
    other = Counted(options(tmp_path, t0=4, max_rounds=8))
    assert len(other.waiting()) == 4
    other.run()
    assert len(read_rows(tmp_path / "trials.csv")) == 32


@pytest.mark.usefixtures("fits_the_toy")
def test_the_best_settings_are_as_studies_take_them(tmp_path: Path) -> None:
    tuner = Counted(options(tmp_path))
    tuner.run()
    best = read_tuned(tmp_path / "best.toml")
    # Trial 1 takes 90 rounds less than trial 0 by what `Counted` tells.
    robots, paper = (
        next(unit.settings for unit in tuner.run_units if (unit.method, unit.trial) == (method, 1))
        for method in ("fl", "maml-shared")
    )
    assert best.robots == robots
    assert best.methods == {"maml": paper[len(robots) :]}
    assert best.methods["maml"][0] == "meta.heads=shared"
    with (tmp_path / "tuning.csv").open(newline="") as file:
        fl, maml = csv.DictReader(file)
    # Seeds 101 to 106 less 90: 11 to 16 rounds, one of them seen, in both arms.
    assert (fl["rounds"], fl["unseen"], fl["saved"], fl["units"]) == ("13.5", "12.5", "", "8")
    assert (maml["rounds"], maml["saved"], maml["saved_unseen"], maml["untuned"]) == ("13.5", "0.0", "0.0", "101.5")
