"""A made-up run priced again by links and robots of its own; see made_up_run for its rows and bytes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price
from jouleswarm.energy.repricing import reprice
from jouleswarm.runs.run import Run, load_run
from jouleswarm.runs.summary import summarise
from tests.made_up_run import Facts

SIDES = "1,2,500e3\n2,1,500e3\n3,4,250e3\n4,3,500e3\n"
UP_AND_DOWN = "1,datacenter,200e3\n3,datacenter,100e3\n" + "".join(
    f"datacenter,{each},200e3\n" for each in (1, 2, 3, 4)
)


@pytest.fixture
def path(write_run: Callable[..., Path], facts: Facts, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.chdir(tmp_path)
    robots = [{"id": 4, "pk_w": 10.2}, {"id": 2, "tk_batch_s": 0.2}]
    return write_run(summarise(facts.scenario, facts.rows, facts.meter_rows), robots=robots)


def _at(run: Run, *changes: str) -> dict[str, float]:
    energy = reprice(run.scenario, changes, "made-up")[0].energy
    bills = {arm: price(literal, facts, energy) for arm, facts in run.facts.items()}
    return {arm: bill.total_j for arm, bill in bills.items() if bill}


def test_each_robot_and_each_link_at_its_own_constants(path: Path, tmp_path: Path) -> None:
    (tmp_path / "links.csv").write_text("from,to,bit_per_j\n" + SIDES + UP_AND_DOWN)
    run = load_run(path)
    # Uniform: 3187.92 and 2452.8 J. Robot 4 draws twice 2.04 J a batch, robot 2 half; 20 batches a round.
    own = {"maml": 6 * 20 * 2.04 - 4 * 20 * 1.02, "fl": 20 * 20 * 2.04 - 10 * 20 * 1.02}
    assert _at(run) == pytest.approx({"maml": 3187.92 + own["maml"], "fl": 2452.8 + own["fl"]})
    # Robot 3 sends at half the efficiency: 60 kB up once more 2.4 J, and 40 kbit a round once more 0.08 J.
    more = {"maml": 2.4 + 6 * 0.08, "fl": 20 * 0.08}
    changed = _at(run, "energy.links=links.csv")
    assert changed == pytest.approx(
        {"maml": 3187.92 + own["maml"] + more["maml"], "fl": 2452.8 + own["fl"] + more["fl"]}
    )


def test_a_link_that_is_not_in_the_table_is_named(path: Path, tmp_path: Path) -> None:
    (tmp_path / "links.csv").write_text("from,to,bit_per_j\n" + SIDES)
    with pytest.raises(ConfigurationError, match=r"no line for the link (1|3) to datacenter, which carried messages"):
        _at(load_run(path), "energy.links=links.csv")


def test_a_table_of_links_that_there_is_not_is_one_line(path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"energy\.links .*nowhere\.csv: cannot be read"):
        _at(load_run(path), "energy.links=nowhere.csv")
