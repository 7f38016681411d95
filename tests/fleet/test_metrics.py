"""A run's metrics: what was spent by when, by arithmetic; what metrics are called, and that others call them so."""

from __future__ import annotations

import io
import json
import re
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar, cast
from urllib.error import URLError
from urllib.request import urlopen

import pytest
from prometheus_client import Metric
from rich.console import Console

from jouleswarm.broker.exporter import BrokerCollector
from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.topics import Link
from jouleswarm.energy.facts import Counts
from jouleswarm.fleet.families import families
from jouleswarm.fleet.metrics import Metrics
from jouleswarm.fleet.recorder import Recorder
from jouleswarm.fleet.spent import Spent
from jouleswarm.runs.run import load_run
from jouleswarm.runs.summary import summarise

ROOT = Path(__file__).parents[2]
TOY = ROOT / "scenarios" / "toy.toml"


@pytest.fixture(scope="module")
def toy() -> Scenario:
    return load_scenario(TOY, ["meta.adapt_from=[1]"])  # arms maml-t1, maml and fl


def row(phase: str, arm: str, task: int, agent: int, round_: int, **more: Any) -> RoundRow:
    return RoundRow(phase=phase, arm=arm, task=task, agent=agent, round=round_, seconds=1, **more)  # type: ignore[arg-type]


def received(uplink: int = 0, downlink: int = 0, sidelink: int = 0) -> dict[Link, int]:
    return {Link.UPLINK: uplink, Link.DOWNLINK: downlink, Link.SIDELINK: sidelink}


class Heard:
    """Nothing yet but robot 1's row."""

    newest: ClassVar = {("fl", 1, 1): row("fl", "fl", 1, 1, 2, cluster_reward=7.5, refused=3)}
    robots: ClassVar = Counter(here=1, awaited=3)
    refused, elapsed_s = 2, 5.0
    spent: ClassVar = SimpleNamespace(counts={})


def test_an_arm_is_charged_for_the_stage_up_to_the_round_it_starts_from(toy: Scenario) -> None:
    spent = Spent(toy, resumed=False)
    learned = {"gradients": 8, "gradients_support": 5, "gradients_query": 3}
    spent.take(row("maml", "maml", 1, 0, 1, **learned), received(uplink=1000))
    spent.take(row("maml", "maml", 1, 0, 2, **learned), received(uplink=1800))
    assert spent.counts == {
        ("maml-t1", "ml"): Counts(gradients_support=5, gradients_query=3, uplink_bytes=1000),
        ("maml", "ml"): Counts(gradients_support=10, gradients_query=6, uplink_bytes=1800),
    }
    cost = spent.cost("maml", "ml")
    assert cost is not None
    assert cost.uplink_j == pytest.approx(1800 * 8 / toy.energy.ul_bit_per_j)


def test_the_model_that_came_down_is_the_stages_and_the_neighbours_the_tasks(toy: Scenario) -> None:
    spent = Spent(toy, resumed=False)
    spent.take(row("fl", "maml", 1, 1, 0), received(downlink=500))
    spent.take(row("fl", "maml", 1, 1, 1, gradients=10), received(downlink=500, sidelink=300))
    spent.take(row("fl", "maml", 1, 1, 1, gradients=10), received(downlink=500, sidelink=300))  # told again
    spent.take(row("fl", "fl", 1, 1, 1, gradients=10), received(downlink=500, sidelink=700))
    assert spent.counts["maml", "ml"] == Counts(downlink_bytes=500)
    assert spent.counts["maml", "fl"] == Counts(gradients_robots=10, sidelink_bytes=300, sidelink_sent_bytes=300)
    assert spent.counts["fl", "fl"] == Counts(gradients_robots=10, sidelink_bytes=400, sidelink_sent_bytes=400)
    assert spent.received["sidelink"] == 700


def test_what_a_resumed_run_had_received_before_is_not_booked_again(toy: Scenario) -> None:
    spent = Spent(toy, resumed=True)
    spent.take(row("fl", "fl", 1, 1, 7, gradients=10), received(sidelink=9000))
    spent.take(row("fl", "fl", 1, 1, 8, gradients=10), received(sidelink=9300))
    assert spent.counts["fl", "fl"] == Counts(gradients_robots=20, sidelink_bytes=300, sidelink_sent_bytes=300)


def exported(toy: Scenario) -> list[Metric]:
    spent = Spent(toy, resumed=False)
    spent.take(row("fl", "fl", 1, 1, 2, gradients=4), received(sidelink=100))
    costs = {key: cost for key in spent.counts if (cost := spent.cost(*key)) is not None}
    return list(families(toy, "1.2", Heard(), spent.counts, costs))


def test_values_are_labelled_by_arm_task_state_and_cause(toy: Scenario) -> None:
    found = {(each.name, *each.labels.values()): each.value for metric in exported(toy) for each in metric.samples}
    assert found["jouleswarm_reward", "fl", "1"] == 7.5
    assert found["jouleswarm_round", "fl", "fl", "1"] == 2
    assert found["jouleswarm_robots", "awaited"] == 3
    assert found["jouleswarm_gradients_total", "fl", "fl", "robots"] == 4
    assert found["jouleswarm_refused_messages_total", "agent-1", "payload"] == 3
    sidelink_j = 100 * 8 / toy.energy.sl_bit_per_j
    assert found["jouleswarm_energy_joules_total", "fl", "fl", "sidelink"] == pytest.approx(sidelink_j)


def names_of(metric: Metric) -> set[str]:
    ending = {"counter": "_total", "info": "_info"}.get(metric.type, "")
    return {metric.name + ending}


def test_the_dashboard_and_the_docs_name_metrics_and_labels_that_there_are(toy: Scenario) -> None:
    idle: Any = SimpleNamespace(meter=BrokerMeter(), handlers={}, budget=SimpleNamespace(used_bytes=0))
    broker = [*BrokerCollector(idle).collect()]
    there = {name for metric in (*exported(toy), *broker) for name in names_of(metric)}
    dashboard = json.loads((ROOT / "deploy/grafana/dashboards/jouleswarm.json").read_text())
    asked = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    named = {name for expression in asked for name in re.findall(r"jouleswarm_\w+", expression)}
    assert named
    assert named <= there
    labels = {label for metric in (*exported(toy), *broker) for sample in metric.samples for label in sample.labels} | {
        "link",
        "direction",
    }  # the broker's, which has counted nothing here
    for expression in asked:
        for group in re.findall(r"by \(([^)]*)\)", expression):
            assert set(group.split(", ")) <= labels, expression
    docs = (ROOT / "docs/monitoring.md").read_text()
    assert set(re.findall(r"`(jouleswarm_\w+)", docs)) == there


def test_a_port_that_is_taken_is_told_before_anything_is_started() -> None:
    one = Metrics(0, "127.0.0.1")
    try:
        with pytest.raises(ConfigurationError, match=r"--metrics-port .* 0 for a free one"):
            Metrics(one._server.server_port, "127.0.0.1")
    finally:
        one.close()


class Scraping(io.StringIO):
    """A screen: once it says that a scrape is waited for, one comes."""

    def __init__(self) -> None:
        super().__init__()
        self.url, self.body = "", ""
        self.scraping = threading.Thread(target=self._scrape)

    def write(self, text: str) -> int:
        self.url = self.url or "".join(re.findall(r"http://\S+", text))
        if text.startswith("waiting"):
            self.scraping.start()
        return super().write(text)

    def _scrape(self) -> None:
        with urlopen(self.url, timeout=20) as answer:
            self.body = answer.read().decode()


def test_who_scrapes_again_and_again_reads_the_bill_before_the_port_is_closed(
    write_run: Callable[..., Path], facts: Any
) -> None:
    run = load_run(write_run(summarise(facts.scenario, facts.rows, facts.meter_rows)))
    screen, recorder = Scraping(), cast(Recorder, Heard())
    metrics = Metrics(0, "127.0.0.1")
    metrics.begin(Console(file=screen, width=200), run.scenario, recorder)
    for _ in range(2):
        with urlopen(screen.url, timeout=20) as answer:
            assert b"jouleswarm_run_info" in answer.read()
    metrics.end(run)
    metrics.close()
    screen.scraping.join(20)  # its answer is given by now, but perhaps not taken
    # 30 rounds of two robots, 5000 B to the neighbour each.
    assert 'jouleswarm_payload_bytes_total{arm="fl",link="sidelink",phase="fl"} 300000.0' in screen.body
    with pytest.raises(URLError):
        urlopen(screen.url, timeout=20)
