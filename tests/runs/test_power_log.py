"""Logs of power meters as they come."""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.runs.power_log import Log, read_logs

EPOCH = 1_700_000_000.0  # 2023-11-14 22:13:20 UTC


def log(folder: Path, text: str, name: str = "power.csv") -> Path:
    (folder / name).write_text(text)
    return folder / name


@pytest.mark.parametrize(
    "time",
    [
        "1700000000",
        "2023-11-14T22:13:20Z",
        "2023-11-14 23:13:20+01:00",
        "2023/11/14 22:13:20.000",  # nvidia-smi's; no zone: UTC
    ],
)
def test_times_are_epochs_or_iso(time: str, tmp_path: Path) -> None:
    assert read_logs([log(tmp_path, f"time,watt,name\n{time},5.0,agent-1\n")]) == {"agent-1": Log([EPOCH], [5], False)}


def test_one_file_for_several_devices_in_any_order_and_columns_that_do_not_matter(tmp_path: Path) -> None:
    file = log(tmp_path, "name,volt,time,watt\nb,5,2,7\na,5,3,1\na,5,1,2\n\n")
    assert read_logs([file]) == {"b": Log([2], [7], False), "a": Log([1, 3], [2, 1], False)}


def test_a_file_as_nvidia_smi_writes_it(tmp_path: Path) -> None:
    text = "timestamp, power.draw [W], name\n2023/11/14 22:13:20.500, 65.43 W, NVIDIA H200\n"
    assert read_logs([log(tmp_path, text)]) == {"NVIDIA H200": Log([EPOCH + 0.5], [65.43], False)}


def test_a_counter_of_joules_and_a_file_named_as_its_device(tmp_path: Path) -> None:
    file = log(tmp_path, "time,joules\n1,100\n2,105.5\n", "agent-3.csv")
    assert read_logs([file]) == {"agent-3": Log([1, 2], [100, 105.5], True)}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("when,watt\n1,2\n", "its columns are when, watt; expected time, watt, name"),
        ("", "expected time, watt, name"),
        ("time,watt,name\n-1,5,a\n", "line 2: time '-1', expected seconds since 1970 or an ISO 8601 time"),
        ("time,watt,name\nnoon,5,a\n", "line 2: time 'noon', expected a finite number"),
        ("time,watt,name\n1,5,a\n2,nan,a\n", "line 3: watt 'nan', expected a finite number"),
        ("time,watt,name\n1,[N/A],a\n", r"line 2: watt '\[N/A\]', expected a finite number"),
        ("time,watt,name\n1,5\n", "line 2: 2 fields, expected 3"),
        ("time,watt,name\n1,5,a\n1,6,a\n", "a has two samples of one moment, expected a name for each device"),
    ],
)
def test_what_is_no_sample_is_one_line(text: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=told):
        read_logs([log(tmp_path, text)])


def test_what_is_no_file_of_text_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_bytes(b"\xff\xfe\x00")
    for name, told in (("x.csv", "no CSV file"), ("missing.csv", "No such file")):
        with pytest.raises(ConfigurationError, match=told):
            read_logs([tmp_path / name])
