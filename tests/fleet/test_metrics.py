"""What a run tells Prometheus while it goes on: the recorder's knowledge, over real HTTP."""

from __future__ import annotations

import socket
from pathlib import Path
from urllib.request import urlopen

import pytest
from prometheus_client.parser import text_string_to_metric_families
from rich.console import Console

from jouleswarm.common.bus.bus import MemoryHub
from jouleswarm.common.bus.reporter import Telemetry
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import encode_json
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.fleet.metrics import with_metrics
from jouleswarm.fleet.recorder import Recorder
from jouleswarm.runs.directory import RunDirectory

SCENARIO = {
    "name": "t",
    "methods": ["fl"],
    "world": {"rows": 3, "cols": 2},
    "energy": {"pk_w": 4, "tk_batch_s": 0.5, "ul_bit_per_j": 1e3, "sl_bit_per_j": 1e3},
    "tasks": [{"id": 1, "map": "E . \n * . \n X ."}],
}


def scraped(url: str) -> dict[tuple[str, ...], float]:
    text = urlopen(url, timeout=10).read().decode()
    samples = (sample for family in text_string_to_metric_families(text) for sample in family.samples)
    return {(each.name, *map(str, each.labels.values())): each.value for each in samples}


def test_rounds_bytes_and_joules_by_cause_and_arm_are_scraped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hub, scenario = MemoryHub(), scenario_from(SCENARIO, "test")
    recorder = Recorder(hub.connect("recorder"), scenario, "r", RunDirectory(tmp_path / "run"))
    others = hub.connect("others")

    def tell(agent: int, round_: int) -> None:
        fields = {"phase": "fl", "arm": "fl", "task": 1, "agent": agent, "round": round_, "seconds": 1, "gradients": 10}
        row = RoundRow.model_validate({**fields, "cluster_reward": 7.0})
        received = {"uplink": 0, "downlink": 0, "sidelink": 500 * round_, "control": 1}
        topic = topics.telemetry("r", "fl", f"agent-{agent}")
        others.publish(topic, encode_json(Telemetry(row=row, received=received)))
        recorder.pump(0.05)

    with with_metrics(0, None)(Console(), scenario, recorder) as view:
        url = capsys.readouterr().out.split()[-1]
        for agent, round_ in ((1, 1), (2, 1), (1, 2), (1, 2)):  # the last is told again, after a restart say
            tell(agent, round_)
        view.update()
        found = scraped(url)
    assert found["jouleswarm_round", "fl", "1", "1"] == 2
    assert found["jouleswarm_reward", "fl", "1"] == 7
    # Three rounds of 10 gradients, 4 W for 0.5 s each.
    assert found["jouleswarm_gradients_total", "fl", "robots"] == 30
    assert found["jouleswarm_joules_total", "fl", "computing_robots"] == 60
    # 1000 B by robot 1 and 500 B by robot 2, 8 bits each, at 1 kb/J.
    assert found["jouleswarm_received_bytes_total", "sidelink"] == 1500
    assert found["jouleswarm_joules_total", "all", "sidelink"] == 12


def test_a_port_that_is_in_use_is_told_before_anything_runs() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(ConfigurationError, match="name another, or 0 for a free one"):
            with_metrics(taken.getsockname()[1], None)
