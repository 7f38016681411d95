"""The run directory."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from common.errors import ConfigurationError, RunError
from common.meter import Meter
from common.runlog import RoundRow, RunDirectory


def row(**fields: Any) -> RoundRow:
    return RoundRow.model_validate(
        {"phase": "fl", "arm": "maml", "task": 1, "agent": 1, "round": 1, "seconds": 0.5} | fields
    )


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_a_directory_that_is_not_empty_is_never_written_into(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    with pytest.raises(ConfigurationError, match="is not empty; name another"):
        RunDirectory(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["precious"]


def test_an_empty_or_new_directory_is_taken(tmp_path: Path) -> None:
    assert RunDirectory(tmp_path).path == tmp_path
    assert (RunDirectory(tmp_path / "a" / "b").path / "weights").is_dir()


def test_rows_are_on_disk_as_they_come(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    directory.round(row(agent=2, round=7))
    assert [each["round"] for each in lines(tmp_path / "rounds.jsonl")] == [7]
    directory.round(row(agent=1, round=6))
    assert [each["round"] for each in lines(tmp_path / "rounds.jsonl")] == [7, 6]
    assert [each.round for each in directory.rows] == [7, 6]


def test_the_finished_file_is_in_order_whatever_came_first(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    ordered = [
        row(arm="fl", task=1, agent=1, round=1),
        row(phase="maml", task=1, agent=0, round=1),
        row(phase="maml", task=1, agent=0, round=2),
        row(phase="maml", task=1, agent=1, round=1),
        row(task=1, agent=1, round=2),
        row(task=1, agent=1, round=10),
        row(task=2, agent=3, round=1),
    ]
    for each in (ordered[6], ordered[4], ordered[5], ordered[3], ordered[1], ordered[2], ordered[0]):
        directory.round(each)
    directory.summary({"seed": 1})
    assert [RoundRow.model_validate(each) for each in lines(tmp_path / "rounds.jsonl")] == ordered
    assert json.loads((tmp_path / "summary.json").read_text()) == {"seed": 1}


def test_meter_and_weights_are_written_whole(tmp_path: Path) -> None:
    directory, meter = RunDirectory(tmp_path), Meter("broker")
    meter.count("agent-1", "jouleswarm/r/maml/sl/1/1/weights", "in", 100, 140)
    directory.meter(meter.rows())
    directory.weights("maml-task1", memoryview(b"payload"))
    assert lines(tmp_path / "meter.jsonl") == [
        {
            "side": "broker", "arm": "maml", "phase": "fl", "topic": "jouleswarm/r/maml/sl/1/1/weights",
            "link": "sidelink", "client": "agent-1", "direction": "in",
            "messages": 1, "payload_bytes": 100, "packet_bytes": 140,
        }
    ]  # fmt: skip
    assert (tmp_path / "weights" / "maml-task1.safetensors").read_bytes() == b"payload"
    assert not list(tmp_path.rglob("*.part"))


def test_a_file_that_cannot_be_written_is_an_error_of_ours(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    (tmp_path / "weights").rmdir()
    with pytest.raises(RunError, match=r"cannot write .*No such file or directory"):
        directory.weights("maml-task1", b"payload")


def test_a_row_that_is_there_is_not_written_again(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    for seconds in (0.5, 0.7):
        directory.round(row(seconds=seconds))
    assert [each["seconds"] for each in lines(tmp_path / "rounds.jsonl")] == [0.5]


def test_rows_that_have_not_come_are_completed_by_the_list_of_all(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    ordered = [row(round=1), row(round=2), row(round=3), row(round=4)]
    for each in (ordered[0], ordered[2], ordered[1]):  # the last one comes late: it is left to the list
        directory.round(each)
    assert [each.round for each in directory.rows] == [1, 3]
    directory.complete(ordered)
    directory.complete(ordered)
    assert sorted(each.round for each in directory.rows) == [1, 2, 3, 4]


def test_an_interrupted_run_is_gone_on_with_and_its_torn_lines_are_cut_off(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    directory.manifest({"run": "r"})
    directory.round(row(round=1))
    directory.round(row(round=2))
    directory.progress({"time_s": 1.0})
    directory.weights("maml-task1", b"model")
    directory.meter([])
    directory.summary({"status": "interrupted"})
    for name in ("rounds.jsonl", "progress.jsonl"):
        with (tmp_path / name).open("a") as file:
            file.write('{"phase": "f')

    resumed = RunDirectory(tmp_path, resume=True)
    assert [each.round for each in resumed.rows] == [1, 2]
    assert not (tmp_path / "summary.json").exists()
    assert not (tmp_path / "meter.jsonl").exists()
    assert json.loads((tmp_path / "manifest.json").read_text()) == {"run": "r"}
    assert (tmp_path / "weights" / "maml-task1.safetensors").read_bytes() == b"model"
    resumed.round(row(round=2))
    resumed.round(row(round=3))
    resumed.progress({"time_s": 2.0})
    assert [each["round"] for each in lines(tmp_path / "rounds.jsonl")] == [1, 2, 3]
    assert [each["time_s"] for each in lines(tmp_path / "progress.jsonl")] == [1.0, 2.0]


def test_a_run_killed_before_its_first_row_is_gone_on_with(tmp_path: Path) -> None:
    RunDirectory(tmp_path).manifest({"run": "r"})
    resumed = RunDirectory(tmp_path, resume=True)
    assert resumed.rows == []
    resumed.round(row())
    assert len(lines(tmp_path / "rounds.jsonl")) == 1


@pytest.mark.parametrize("there", [True, False])
def test_what_is_no_run_is_not_gone_on_with(there: bool, tmp_path: Path) -> None:
    path = tmp_path if there else tmp_path / "nowhere"
    with pytest.raises(ConfigurationError, match=r"has no manifest\.json; name one that `jouleswarm run` printed"):
        RunDirectory(path, resume=True)
    assert list(tmp_path.iterdir()) == []


def test_a_figure_that_json_cannot_say_is_an_error_and_no_summary(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path / "r")
    with pytest.raises(
        RunError, match=r"summary\.json: a figure is not finite .*expected finite ones; rows and counters"
    ):
        directory.summary({"arms": {"fl": {"energy_j": math.inf}}})
    assert not (tmp_path / "r" / "summary.json").exists()
