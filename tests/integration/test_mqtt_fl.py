"""The example examples/mqtt_fl as its one command runs it, and that no payload of it is ever unpickled."""

from __future__ import annotations

import json
import os
import pickle
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jouleswarm import Run

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "mqtt_fl"
ENCODINGS = ("JSON lists", "pickle", "safetensors", "int8")
HEADER = (
    '{"bias":{"dtype":"F32","shape":[10],"data_offsets":[0,40]},'
    '"weight":{"dtype":"F32","shape":[64,10],"data_offsets":[40,2600]},'
    '"from":{"dtype":"I32","shape":[2],"data_offsets":[2600,2608]}}'
)
SAFETENSORS = 8 + -(-len(HEADER) // 8) * 8 + 2608  # a length, the header in whole words, 2 + 650 numbers of 4 bytes


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """What the command prints, and its run directory."""
    folder = tmp_path_factory.mktemp("mqtt_fl") / "counts"
    command = [sys.executable, str(EXAMPLE / "run.py"), str(folder)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ended = subprocess.run(command, env=environment, cwd=folder.parent, capture_output=True, text=True, timeout=150)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout, folder


def test_each_encoding_has_its_line_and_all_learn_the_same(done: tuple[str, Path]) -> None:
    lines = {line[:12].strip(): line[12:].split() for line in done[0].splitlines()}
    sizes = {name: int(lines[name][0]) for name in ENCODINGS}
    assert sizes["safetensors"] == SAFETENSORS
    assert sizes["JSON lists"] > 4 * sizes["pickle"]
    assert sizes["pickle"] > sizes["safetensors"] > 2 * sizes["int8"]
    for place in (-2, -1):  # by the server, by consensus
        errors = [float(lines[name][place]) for name in ENCODINGS]
        assert errors[:3] == [errors[0]] * 3  # these three lose nothing
        assert 0 < errors[0] < 0.1  # a model of zeros has 64, the variance of 64 features, and the noise 0.01
        assert errors[0] < errors[3] < 0.1  # steps of the largest weight / 127


def test_every_message_is_counted_by_its_rule_and_priced_beside_what_is_computed(done: tuple[str, Path]) -> None:
    run = Run(done[1])
    rows = run.meter[run.meter["kind"] == "publish"]
    messages = rows.assign(arm=rows["labels"].str["arm"]).groupby(["arm", "link", "direction"])["messages"].sum()
    joules = run.bill()["fl"]
    for name in ENCODINGS:  # 2 learners, 5 rounds
        for link, way in (("uplink", "in"), ("downlink", "out"), ("sidelink", "in"), ("sidelink", "out")):
            assert messages[name, link, way] == 10
        assert messages[name, "downlink", "in"] == 5
        assert joules.at[name, "computing_robots"] == pytest.approx(2 * 2 * 5 * 4 * 5.1 * 0.4)  # by both ways
    assert joules.at["safetensors", "uplink"] == pytest.approx(10 * SAFETENSORS * 8 / 200e3)
    assert joules.at["safetensors", "downlink"] == pytest.approx(10 * SAFETENSORS * 8 / 200e3)
    assert joules.at["safetensors", "sidelink_robots"] == pytest.approx(10 * SAFETENSORS * 8 / 500e3)
    assert set(rows["link"]) == {"uplink", "downlink", "sidelink", "control"}  # nothing without a rule


def test_a_folder_that_holds_something_is_left_as_it_is(done: tuple[str, Path]) -> None:
    before = {path: path.read_bytes() for path in done[1].rglob("*") if path.is_file()}
    command = [sys.executable, str(EXAMPLE / "run.py"), str(done[1])]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (ended.returncode, "is not empty; name another" in ended.stderr) == (2, True)
    assert {path: path.read_bytes() for path in done[1].rglob("*") if path.is_file()} == before


class _Trap:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("trapped",)


def test_a_pickle_from_the_network_is_read_and_never_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    encode, decode = runpy.run_path(str(EXAMPLE / "payloads.py"))["ENCODINGS"]["pickle"]
    rng = np.random.default_rng(1)
    model = {
        "bias": rng.normal(size=10).astype(np.float32),
        "from": np.array([1, 2], np.int32),
        "weight": rng.normal(size=(64, 10)).astype(np.float32),
    }
    found = decode(encode(model))
    assert all(
        np.array_equal(found[name], tensor) and found[name].dtype == tensor.dtype for name, tensor in model.items()
    )
    assert decode(pickle.dumps({**model, "trap": _Trap()}, protocol=4)).keys() == model.keys()
    for spoilt in (pickle.dumps(_Trap(), protocol=4), json.dumps([1]).encode(), encode(model)[:-200], b""):
        with pytest.raises(ValueError):
            decode(spoilt)
    assert list(tmp_path.iterdir()) == []
