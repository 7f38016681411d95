"""A codec of one's own over a real broker: the example of the documentation, shortened; and one that is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jouleswarm.codecs.codec import codec_of
from jouleswarm.codecs.streams import WeightsEncoder
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.tensorfile import tensor_bytes
from jouleswarm.learning.networks import build_qnetwork, to_weights
from jouleswarm.simulation import run_in_memory
from tests.integration.conftest import ROOT, sets

EXAMPLE = ROOT / "examples" / "sign.toml"
# The toy's network: 4 x 4 on 4 channels to 8, 3 x 3 to 16, 16 x 5 x 3 features to 32, 4 actions; a bias to each.
ENTRIES = [4 * 4 * 4 * 8, 8, 3 * 3 * 8 * 16, 16, 240 * 32, 32, 32 * 4, 4]
WHOLE, SIGNS = 4 * sum(ENTRIES), sum((entries + 7) // 8 for entries in ENTRIES) + 4 * len(ENTRIES)


def test_the_example_runs_from_start_to_bill(start: Any, read_run: Any, small: Any, tmp_path: Path) -> None:
    options = ("--out", str(tmp_path), "--run-id", "sign", "--no-figures")
    started = start.jouleswarm("run", str(EXAMPLE), *options, *sets(*small))
    assert started.ends() == 0, started.printed
    run = read_run(tmp_path / "sign")
    scenario = load_scenario(run.path / "manifest.json")  # with the codec that is kept there
    assert (run.path / "doors" / "sign_codec.py").read_text() == (ROOT / "examples" / "sign_codec.py").read_text()

    encoder, weights = WeightsEncoder(codec_of(scenario)), to_weights(build_qnetwork(scenario, 1))
    header = ModelHeader(task=1, agent=1, round=1, reward=1.0, samples=6)
    whole, signs = encoder.payload(weights, header, 2), encoder.payload(weights, header, 2)
    assert (tensor_bytes(whole), tensor_bytes(signs)) == (WHOLE, SIGNS) == (38128, 1224)
    # 2 clusters of 2 robots, 3 rounds: 4 links with a whole model each, then twice signs
    moved = run.summary["arms"]["fl"]["bytes"]["sidelink"]
    assert (moved["messages"], moved["payload"]) == (12, 4 * len(whole) + 8 * len(signs))

    outcome = run_in_memory(scenario)
    assert {f"{arm}-task{task}.safetensors": payload for (arm, task), payload in outcome.learned.items()}.items() <= (
        run.weights.items()
    )


def test_a_codec_that_does_not_round_trip_ends_every_process_before_it_begins(start: Any, tmp_path: Path) -> None:
    text = (ROOT / "examples" / "sign_codec.py").read_text()
    assert "np.float32(2) - 1" in text
    (tmp_path / "sign_codec.py").write_text(text.replace("np.float32(2) - 1", "2.0 - 1"))
    scenario = tmp_path / "sign.toml"
    scenario.write_text(EXAMPLE.read_text())
    told = (
        f"scenario {scenario}: codec 'sign_codec:Sign': decode gives 0.weight as float64 (3, 2, 2, 2), "
        "expected float32 (3, 2, 2, 2)"
    )
    out = tmp_path / "runs"
    command = start.jouleswarm("run", str(scenario), "--out", str(out))
    robot = start.python("jouleswarm.agents", "--quiet", "--id", "1", "--scenario", str(scenario))
    center = start.python("jouleswarm.datacenter", "--quiet", "--scenario", str(scenario))
    assert [each.ends() for each in (command, robot, center)] == [2, 2, 2]
    for each, name in ((command, "jouleswarm run"), (robot, "robot 1"), (center, "data center")):
        assert each.printed == f"{name}: {told}\n"
    assert not out.exists()
