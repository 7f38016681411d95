"""Methods of one's own over a real broker: the examples, a warm start, and a finished run with more rounds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import safetensors.numpy

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.simulation import run_in_memory
from tests.integration.conftest import ROOT, sets

EXAMPLES = ROOT / "examples"


def test_the_median_runs_over_a_graph_of_one_s_own_from_start_to_bill(
    start: Any, read_run: Any, small: Any, tmp_path: Path
) -> None:
    options = ("--out", str(tmp_path), "--run-id", "median", "--no-figures")
    started = start.jouleswarm("run", str(EXAMPLES / "median.toml"), *options, *sets(*small))
    assert started.ends() == 0, started.printed
    run = read_run(tmp_path / "median")
    for name in ("median.py", "edges.csv"):
        assert (run.path / "doors" / name).read_bytes() == (EXAMPLES / name).read_bytes()
    # 2 clusters, each a line of three: 4 directed links, 3 rounds
    assert run.summary["arms"]["median"]["bytes"]["sidelink"]["messages"] == 2 * 4 * 3
    assert run.summary["arms"]["median"]["method"] == "median"

    outcome = run_in_memory(load_scenario(run.path / "manifest.json"))  # with what is kept there
    for (arm, task), payload in outcome.learned.items():
        assert run.weights[f"{arm}-task{task}.safetensors"] == payload
    reported = start.jouleswarm("report", str(run.path), "--no-figures")
    assert reported.ends() == 0, reported.printed
    assert "coordinate-wise median" in reported.printed


def test_fedprox_runs_with_neighbours_and_by_the_data_center(
    start: Any, read_run: Any, small: Any, tmp_path: Path
) -> None:
    options = ("--out", str(tmp_path), "--run-id", "fedprox", "--no-figures")
    started = start.jouleswarm("run", str(EXAMPLES / "fedprox.toml"), *options, *sets(*small))
    assert started.ends() == 0, started.printed
    arms = read_run(tmp_path / "fedprox").summary["arms"]
    links = {
        arm: tuple(arms[arm]["bytes"][link]["messages"] for link in ("uplink", "downlink", "sidelink")) for arm in arms
    }
    # 4 robots, 3 rounds: to a neighbour each, or up and down
    assert links == {"fl": (0, 0, 12), "fedprox": (0, 0, 12), "fedprox-server": (12, 12, 0)}


def test_a_run_begins_from_a_model_of_an_earlier_one_and_goes_on_with_more_rounds(
    start: Any, read_run: Any, small_run: Any, tmp_path: Path
) -> None:
    scenario = tmp_path / "toy.toml"
    scenario.write_text((ROOT / "scenarios" / "toy.toml").read_text())
    model = small_run.path / "weights" / "fl-task1.safetensors"
    changes = (
        "methods=['fl','fedavg']", "federation.target_reward=1000", "learning.motions_per_round=6",
        "learning.batches_per_round=4", f"learning.init={model}",
    )  # fmt: skip

    def run(name: str, rounds: int, *options: str) -> None:
        where = ("--out", str(tmp_path / "runs"), "--run-id", name, "--no-figures", *options)
        started = start.jouleswarm("run", str(scenario), *where, *sets(*changes, f"federation.max_rounds={rounds}"))
        assert started.ends() == 0, started.printed

    def resumed(*settings: str) -> Any:
        options = ("--resume", str(tmp_path / "runs" / "short"), "--no-figures", *sets(*settings))
        return start.jouleswarm("run", *options)

    run("short", 1, "--keep-state")
    run("long", 3)
    for settings, told in (
        (("federation.max_rounds=1",), "max_rounds 1 after 1, target_reward 1000 after 1000; expected higher"),
        (("federation.max_rounds=9", "seed=4"), "--set changes more than how long it goes on"),
    ):
        refused = resumed(*settings)
        assert refused.ends() == 2
        assert told in refused.printed
    assert resumed("federation.max_rounds=3").ends() == 0

    short, long = (read_run(tmp_path / "runs" / name) for name in ("short", "long"))
    assert short.weights == long.weights
    assert [short.summary["arms"][arm]["energy_j"] for arm in ("fl", "fedavg")] == [
        long.summary["arms"][arm]["energy_j"] for arm in ("fl", "fedavg")
    ]
    told = [_rows(run.path) for run in (short, long)]
    assert told[0] == told[1]
    kept = json.loads((short.path / "manifest.json").read_text())
    assert kept["continued"][0]["max_rounds"] == 1
    assert safetensors.numpy.load_file(short.path / "doors" / "fl-task1.safetensors").keys()
    assert not (long.path / "state").exists()
    ended = start.jouleswarm("run", "--resume", str(long.path), *sets("federation.max_rounds=9"))
    assert ended.ends() == 2
    assert "does not keep how its arms ended; run the scenario with --keep-state" in ended.printed


def _rows(run: Path) -> list[dict[str, Any]]:
    rows = map(json.loads, (run / "rounds.jsonl").read_text().splitlines())
    return [{**row, "seconds": 0, "refused": 0} for row in rows]
