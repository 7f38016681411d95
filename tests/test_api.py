"""Runs from Python: the made-up run of conftest.py as data frames."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import jouleswarm
from jouleswarm import Run, literal
from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.meter.meter import MeterRow
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.energy.facts import Facts
from jouleswarm.runs.summary import summarise


@pytest.fixture
def done(write_run: Callable[..., Path], facts: Any) -> Run:
    return Run(write_run(summarise(facts.scenario, facts.rows, facts.meter_rows)))


def test_importing_the_package_loads_nothing() -> None:
    code = "import sys, jouleswarm; print({'torch', 'numpy', 'pandas', 'pydantic'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"


def test_what_is_not_there_is_no_attribute() -> None:
    assert {"run", "Run", "literal"} <= set(dir(jouleswarm))
    with pytest.raises(AttributeError, match="module 'jouleswarm' has no attribute 'walk'"):
        _ = jouleswarm.walk


def test_rounds_and_meter_have_the_columns_of_their_files(done: Run, facts: Any) -> None:
    assert list(done.rounds.columns) == list(RoundRow.model_fields)
    assert len(done.rounds) == len(facts.rows)
    last = done.rounds.query("phase == 'fl'").groupby(["arm", "task"])["round"].max()
    assert last.to_dict() == {("maml", 1): 4, ("maml", 2): 6, ("fl", 1): 10, ("fl", 2): 20}
    assert list(done.meter.columns) == list(MeterRow.model_fields)
    delivered = done.meter.query("side == 'broker' and direction == 'out' and client != 'mosquitto_sub'")
    moved = delivered.groupby(["arm", "link"])["payload_bytes"].sum()
    assert (moved["maml", "uplink"], moved["fl", "sidelink"]) == (120_000, 300_000)


def test_a_run_says_what_it_is(done: Run) -> None:
    assert (done.status, done.scenario.name, done.facts("maml").t0) == ("complete", "made-up", 3)
    assert repr(done) == f"<Run {done.path}, complete>"
    with pytest.raises(ConfigurationError, match="arm 'x': expected one of maml, fl"):
        done.facts("x")


def test_a_bill_is_joules_by_arm_phase_and_cause(done: Run) -> None:
    bill = done.bill()
    assert (bill.index.name, list(bill.index), bill.columns.names) == ("arm", ["maml", "fl"], ["phase", "cause"])
    causes = [
        "computing_datacenter",
        "computing_robots",
        "uplink",
        "downlink",
        "sidelink_robots",
        "sidelink_datacenter",
    ]
    assert list(bill.columns) == [(phase, cause) for phase in ("ml", "fl") for cause in causes]
    assert bill.loc["maml", "ml"].tolist() == pytest.approx([2364.72, 0, 4.8, 0.8, 0, 0])
    assert bill.loc["fl", "fl"].tolist() == pytest.approx([0, 2448.0, 0, 0, 4.8, 0])
    assert bill.sum(axis="columns").tolist() == pytest.approx([3187.92, 2452.8])


def test_any_constant_prices_it_again(done: Run) -> None:
    other = done.bill(ul_bit_per_j=100e3, p0_w=1180, sidelink="via_base_station")
    # twice the power, twice the price of the uplink and of the downlink, which follows it
    assert other.loc["maml", "ml"].tolist() == pytest.approx([4729.44, 0, 9.6, 1.6, 0, 0])
    # 100,000 B of weights up at 100 kb/J and down at PUE 1.67
    assert other.loc["maml", "fl"].tolist()[4:] == pytest.approx([8.0, 13.36])
    assert done.bill().loc["maml", "ml"].iloc[0] == pytest.approx(2364.72)
    with pytest.raises(ConfigurationError, match=r"energy\.pue: Input should be greater than or equal to 1, got 0\.5"):
        done.bill(pue=0.5)


def test_a_list_is_named_as_in_a_scenario_or_given_itself(done: Run, tmp_path: Path, monkeypatch: Any) -> None:
    class Standby:
        name, label = "standby", "2 W in all rounds"

        def price(self, facts: Facts, energy: Any) -> Any:
            idle = sum(2.0 * work.seconds for work in facts.work if work.robot and work.phase == "fl")
            return literal.price(facts, energy).plus(fl={"other_robots_j": idle})

    bill = done.bill(Standby())
    # 20 and 60 rounds of 2.0 s
    assert bill["fl", "other_robots"].tolist() == [80.0, 240.0]
    assert not any(cause in ("untold", "other_datacenter") for _, cause in bill.columns)
    (tmp_path / "mine.py").write_text(
        "from jouleswarm.energy.literal import Literal\nclass Mine(Literal): name = label = 'mine'\n"
    )
    monkeypatch.chdir(tmp_path)
    pd.testing.assert_frame_equal(done.bill("mine:Mine"), done.bill())
    with pytest.raises(ConfigurationError, match="price list 'litteral': expected distance, frames, literal, "):
        done.bill("litteral")


def test_what_a_list_does_not_define_or_bytes_do_not_tell_is_not_known(
    write_run: Callable[..., Path], done: Run
) -> None:
    assert done.bill("published").isna().all(axis=None)  # two training robots
    assert list(done.bill("published").columns)[-1] == ("fl", "sidelink_datacenter")


def test_an_interrupted_run_has_what_was_written(write_run: Callable[..., Path], facts: Any) -> None:
    path = write_run()
    done = Run(path)
    assert (done.status, len(done.rounds), len(done.meter)) == ("interrupted", len(facts.rows), 0)
    assert list(done.meter.columns) == list(MeterRow.model_fields)
    bill = done.bill()
    assert bill["ml", "computing_datacenter"].tolist() == pytest.approx([2364.72, 0])
    assert bill["ml", "uplink"].isna().all()
    with Lock(path, "somebody"):
        assert done.status == "running"
        with (path / "rounds.jsonl").open("a") as file:
            file.write(facts.rows[-1].model_copy(update={"round": 21}).model_dump_json() + "\n")
        assert len(done.rounds) == len(facts.rows) + 1
    assert done.status == "interrupted"


def test_a_scenario_may_be_a_dict_and_names_files_in_the_current_folder(tmp_path: Path, monkeypatch: Any) -> None:
    data = {"name": "x", "world": {"rows": 2, "cols": 2}, "tasks": [{"id": 1, "map": "E*\n.X"}], "methods": ["fl"]}
    monkeypatch.chdir(tmp_path)
    scenario = load_scenario(data, [("federation.max_rounds", 7), "seed=5", ("energy.prices", ["mine:Mine"])])
    assert (scenario.federation.max_rounds, scenario.seed, data.get("seed")) == (7, 5, None)
    (tmp_path / "mine.py").touch()
    assert scenario.files == {"mine.py": tmp_path / "mine.py"}
    assert load_scenario("toy", [("energy.prices", ["mine:Mine"])]).files == scenario.files
    with pytest.raises(ConfigurationError, match="scenario given as a dict: tasks: Field required"):
        load_scenario({"name": "x"})
