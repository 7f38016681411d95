"""Methods of one's own over a real broker: the examples, a warm start, and a finished run with more rounds."""

from __future__ import annotations

import shutil
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
    reported = start.jouleswarm("report", str(run.path))
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

    where = ("--out", str(tmp_path), "--run-id", "more", "--no-figures", "--keep-state")
    begun = start.jouleswarm("run", str(scenario), *where, *sets(*changes, "federation.max_rounds=1"))
    assert begun.ends() == 0, begun.printed

    def resumed(path: Path, *settings: str) -> Any:
        return start.jouleswarm("run", "--resume", str(path), "--no-figures", *sets(*settings))

    path, done = tmp_path / "more", tmp_path / "done"
    shutil.copytree(small_run.path, done)
    for of, settings, told in (
        (path, ("federation.max_rounds=1",), "max_rounds 1 after 1, target_reward 1000 after 1000; expected higher"),
        (path, ("federation.max_rounds=9", "seed=4"), "--set changes more than how long it goes on"),
        (done, ("federation.max_rounds=9",), "not keep how its arms ended; run the scenario with --keep-state"),
    ):
        refused = resumed(of, *settings)
        assert refused.ends() == 2
        assert told in refused.printed
    assert resumed(path, "federation.max_rounds=3").ends() == 0

    run = read_run(path)
    outcome = run_in_memory(load_scenario(scenario, [*changes, "federation.max_rounds=3"]))
    assert run.weights == {f"{arm}-task{task}.safetensors": each for (arm, task), each in outcome.learned.items()}
    undisturbed = [row.model_dump(mode="json", exclude={"seconds", "refused"}) for row in outcome.rows]
    assert [{key: row[key] for key in row if key != "refused"} for row in run.figures] == undisturbed
    # 3 rounds, 4 robots: to a neighbour each, or up and down; each counted once
    links = [("fl", "sidelink"), ("fedavg", "uplink"), ("fedavg", "downlink")]
    assert [run.summary["arms"][arm]["bytes"][link]["messages"] for arm, link in links] == [12, 12, 12]
    assert run.manifest["continued"][0]["max_rounds"] == 1
    assert safetensors.numpy.load_file(path / "doors" / "fl-task1.safetensors").keys()
