"""On what a process computes, and who is told when it is another."""

from __future__ import annotations

import logging
import platform
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from jouleswarm.common import host as module
from jouleswarm.common.disk.state import STATE_FILE, State
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.host import PROCESSOR, Others, arithmetic, same_arithmetic
from jouleswarm.common.wire.messages import Presence

HERE, THERE = "AVX2, one, 1 thread", "DEFAULT, one, 1 thread"
INTEL = "processor\t: 0\ncpu family\t: 6\nmodel\t\t: 85\nmodel name\t: Some(R) CPU\n\nprocessor\t: 1\n"


def has_state(folder: Path) -> Path:
    StateFile(folder / STATE_FILE, "owner").save(State(values={"round": 1}))
    return folder


def test_a_line_says_all_that_decides_how_sums_round(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in module._SWITCHES:
        monkeypatch.delenv(name, raising=False)
    here = arithmetic()
    assert here.split(", ") == [
        torch.backends.cpu.get_cpu_capability(), module._processor_model(), platform.machine(), "1 thread",
        f"torch {torch.__version__}", f"numpy {np.__version__}", f"opencv {cv2.__version__}",
    ]  # fmt: skip
    assert arithmetic("CUDA") == f"CUDA, {here}"
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", "AVX2")
    assert arithmetic() == f"{here}, ONEDNN_MAX_CPU_ISA=AVX2"
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: "DEFAULT")
    assert arithmetic().startswith("DEFAULT, ")
    Presence(agent=1, processor=arithmetic("x" * 1000))  # it fits


def test_the_processor_is_named_as_the_kernel_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module._processor_model.cache_clear()
    (tmp_path / "cpuinfo").write_text(INTEL)
    monkeypatch.setattr(module, "_CPU_INFO", tmp_path / "cpuinfo")
    assert module._processor_model() == "Some(R) CPU cpu family 6 model 85"
    module._processor_model.cache_clear()


def test_a_state_of_another_processor_is_refused_and_stays_as_it_is(tmp_path: Path) -> None:
    same_arithmetic(has_state(tmp_path), HERE, other_processor=False)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(ConfigurationError, match=f"begun on {HERE}; this is {THERE}.*--other-processor"):
        same_arithmetic(tmp_path, THERE, other_processor=False)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    same_arithmetic(tmp_path, HERE, other_processor=False)


def test_who_insists_goes_on_and_the_folder_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    same_arithmetic(has_state(tmp_path), HERE, other_processor=False)
    with caplog.at_level(logging.WARNING):
        same_arithmetic(tmp_path, THERE, other_processor=True)
    assert f"begun on {HERE}; going on on {THERE}" in caplog.text
    assert (tmp_path / PROCESSOR).read_text() == f"{HERE}\n{THERE}\n"
    same_arithmetic(tmp_path, THERE, other_processor=False)  # it is where it was last
    with pytest.raises(ConfigurationError):
        same_arithmetic(tmp_path, HERE, other_processor=False)


def test_a_folder_without_a_state_belongs_to_who_comes(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    same_arithmetic(folder, HERE, other_processor=False)
    same_arithmetic(folder, THERE, other_processor=False)
    assert (folder / PROCESSOR).read_text() == f"{THERE}\n"
    same_arithmetic(None, HERE, other_processor=False)


def test_each_other_processor_in_the_run_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    others = Others(HERE)
    with caplog.at_level(logging.WARNING):
        for agent, processor in ((1, HERE), (2, THERE), (3, THERE), (2, THERE), (0, None)):
            others.heard(Presence(agent=agent, processor=processor))
    assert [record.getMessage() for record in caplog.records] == [
        f"robot 2 computes on {THERE}, this process on {HERE}: weights may be others than on one alone"
    ]
