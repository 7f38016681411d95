"""What other tools are given of a run: the made-up one of tests/made_up_run.py."""

from __future__ import annotations

import io
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from rich.console import Console

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.literal import literal
from jouleswarm.fleet.spent import Spent
from jouleswarm.report.exported import write_tables
from jouleswarm.report.live_mlflow import LiveRuns
from jouleswarm.report.mlflow import log_run
from jouleswarm.report.scalars import Growing, scalars
from jouleswarm.report.tensorboard import write_events
from jouleswarm.runs.run import Run, load_run
from jouleswarm.runs.summary import summarise


@pytest.fixture
def run(write_run: Callable[..., Path], facts: Any) -> Run:
    return load_run(write_run(summarise(facts.scenario, facts.rows, facts.meter_rows)))


@pytest.mark.parametrize(("kind", "read"), [("csv", pd.read_csv), ("parquet", pd.read_parquet)])
def test_tables_are_read_back_as_they_were(
    kind: Any, read: Callable[[Path], pd.DataFrame], run: Run, tmp_path: Path
) -> None:
    written = {path.stem: read(path) for path in write_tables(run, tmp_path / "out", kind)}
    assert set(written) == {"rounds", "meter", "curves", "arms", "joules"}
    assert len(written["rounds"]) == len(run.rows)
    assert len(written["meter"]) == len(run.meter_rows)
    # Two tasks of two robots, 10 and 20 rounds, 20 gradients each.
    rounds = written["rounds"]
    assert rounds[(rounds["arm"] == "fl") & (rounds["agent"] > 0)]["gradients"].sum() == 2 * 30 * 20
    arms, joules = written["arms"].set_index("arm"), written["joules"]
    assert list(arms.loc["fl", ["rounds", "learned"]]) == [30, 1]
    assert joules[joules["arm"] == "fl"]["joules"].sum() == pytest.approx(arms.loc["fl", "joules"])


def test_series_are_by_round_and_end_at_the_bill(run: Run) -> None:
    found = list(scalars(run, "fl"))
    rewards = [(each.round, each.value) for each in found if each.name == "R/task-1"]
    assert rewards[:2] == [(1, 5.5), (2, 11.0)]  # 55 x round / 10
    spent = [each.value for each in found if each.name == "spent/gradients"]
    assert spent[-1] == 2 * 30 * 20


def test_tensorboard_reads_the_events_that_are_written_once(run: Run, tmp_path: Path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
    from tensorboard.util.tensor_util import make_ndarray

    written = write_events(run, tmp_path / "events")
    assert [each.name for each in written] == ["maml", "fl"]
    events = EventAccumulator(str(tmp_path / "events" / "fl"))
    events.Reload()
    points = [(each.step, float(make_ndarray(each.tensor_proto))) for each in events.Tensors("R/task-1")]
    assert points[-1] == (10, 55.0)
    with pytest.raises(ConfigurationError, match="has events already"):
        write_events(run, tmp_path / "events")


def test_mlflow_has_a_run_for_each_arm_once(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_ALLOW_FILE_STORE", "true")  # a database takes seconds to be made
    from mlflow.tracking import MlflowClient

    uri = (tmp_path / "mlruns").as_uri()
    assert log_run(run, uri) == ["made-up/maml", "made-up/fl"]
    client = MlflowClient(tracking_uri=uri)
    found = client.search_runs([client.get_experiment_by_name("made-up").experiment_id])
    assert {each.info.run_name for each in found} == {"made-up/maml", "made-up/fl"}
    assert {each.data.params["meta.t0"] for each in found} == {"3"}
    assert {each.data.metrics["R/task-1"] for each in found} == {55.0}
    with pytest.raises(ConfigurationError, match="has made-up in its experiment made-up already"):
        log_run(run, uri)


class Heard:
    """A recorder, as far as followers look at it."""

    def __init__(self, run: Run) -> None:
        self.run, self.spent = run.name, Spent(run.scenario, resumed=False)


def test_series_that_grow_are_told_by_round_and_end_at_the_bill(run: Run) -> None:
    heard, told = Heard(run), []
    growing = Growing(run.scenario, heard.spent)
    for round_, agent in ((1, 1), (1, 2), (2, 1), (2, 2)):  # 20 gradients each
        (row,) = [each for each in run.rows if (each.arm, each.agent, each.round) == ("fl", agent, round_)]
        told += growing.take(row)
        heard.spent.take(row, {Link.SIDELINK: 5000 * round_})
    gradients = [(arm, each.round, each.value) for arm, each in told if each.name == "spent/gradients"]
    assert gradients == [("fl", 1, 40)]
    assert [each.value for _, each in told if each.name == "spent/bits"] == [2 * 5000 * 8]
    assert [each.value for _, each in told if each.name == "R/task-1"] == [5.5, 11.0]
    last = {each.name: each.value for arm, each in growing.end(run) if arm == "fl"}
    bill = literal.price(run.facts["fl"], run.scenario.energy)
    assert last["bill/joules"] == last["spent/joules"] == pytest.approx(bill.total_j)
    assert last["bill/sidelink"] == pytest.approx(bill.both.sidelink_j)


def test_a_tracking_server_that_is_not_there_is_told_once_and_harms_nothing(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))  # and does not listen
        uri = f"http://127.0.0.1:{nobody.getsockname()[1]}"
        console, follower = Console(file=io.StringIO(), width=400), LiveRuns(uri)
        follower.begin(console, run.scenario, Heard(run))
        for row in run.rows:
            follower.take(row)
        follower.end(run)
        follower.close()
    assert isinstance(console.file, io.StringIO)
    (line,) = console.file.getvalue().splitlines()
    assert line.startswith(f"MLflow at {uri}: ")
    assert line.endswith(f"the run goes on without. Afterwards: jouleswarm export RUN --to mlflow --uri {uri}")
