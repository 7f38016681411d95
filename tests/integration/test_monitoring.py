"""One run as Prometheus, TensorBoard and MLflow see it while it goes on, each asked at its own server."""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import urllib.error
import urllib.parse
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.energy.bill import CAUSES
from tests.integration.conftest import TOY, Run, Started, free_port, sets, wait_until

pytestmark = pytest.mark.external

PROMETHEUS, PROMTOOL = shutil.which("prometheus"), shutil.which("promtool")
ARMS = ("maml", "fl")
LOCAL = {"MLFLOW_DISABLE_TELEMETRY": "true", "NO_PROXY": "127.0.0.1", "no_proxy": "127.0.0.1"}
_DIRECT = urllib.request.build_opener(urllib.request.ProxyHandler({}))


def fetch(url: str, **query: str) -> str:
    with _DIRECT.open(f"{url}?{urllib.parse.urlencode(query)}" if query else url, timeout=20) as answer:
        return str(answer.read().decode())


def answers(url: str) -> bool:
    with contextlib.suppress(OSError):
        return bool(fetch(url) or True)
    return False


@dataclass
class Watched:
    """A run that is over, what its metrics were at the first look, and where the servers are."""

    run: Run
    first_metrics: str
    prometheus: str | None
    mlflow: str
    events: Path

    def joules(self, arm: str) -> dict[str, float]:
        """By cause, as the summary has them."""
        found: dict[str, float] = self.run.summary["arms"][arm]["energy_j"]["by_cause"]
        return found


def prometheus(starter: Any, folder: Path, metrics_port: int) -> str | None:
    if PROMETHEUS is None:
        return None
    settings = folder / "prometheus.yml"
    settings.write_text(
        "global: {scrape_interval: 1s}\n"
        f"scrape_configs: [{{job_name: run, static_configs: [{{targets: ['127.0.0.1:{metrics_port}']}}]}}]\n"
    )
    address = f"127.0.0.1:{free_port()}"
    own = f"--config.file={settings}", f"--storage.tsdb.path={folder / 'tsdb'}", f"--web.listen-address={address}"
    starter(PROMETHEUS, *own)
    return f"http://{address}"


@pytest.fixture(scope="module")
def watched(starter: Any, read_run: Any, small: tuple[str, ...], tmp_path_factory: pytest.TempPathFactory) -> Watched:
    folder = tmp_path_factory.mktemp("watched")
    port, metrics_port = free_port(), free_port()
    mlflow = f"http://127.0.0.1:{port}"
    store = f"sqlite:///{folder}/mlflow.db", "--default-artifact-root", str(folder / "artifacts")
    server = "mlflow", "server", "--port", str(port), "--workers", "1", "--backend-store-uri", *store
    starter.python(*server, **LOCAL)
    scraping = prometheus(starter, folder, metrics_port)
    wait_until(lambda: answers(f"{mlflow}/health"), "MLflow's server")
    if scraping is not None:
        wait_until(lambda: answers(f"{scraping}/-/ready"), "Prometheus")
    run: Started = starter.jouleswarm(
        *("run", str(TOY), "--no-figures", "--out", str(folder), "--run-id", "watched", *sets(*small)),
        *("--metrics-port", str(metrics_port), "--tensorboard", str(folder / "events"), "--mlflow", mlflow),
        **LOCAL,
    )
    url = f"http://127.0.0.1:{metrics_port}/metrics"
    wait_until(lambda: answers(url) and "jouleswarm_run_info" in fetch(url), "metrics of the run")
    first = fetch(url)
    assert run.ends() == 0, run.printed
    return Watched(read_run(folder / "watched", run.printed), first, scraping, mlflow, folder / "events")


def test_a_real_prometheus_has_the_summarys_joules_in_the_end(watched: Watched) -> None:
    if watched.prometheus is None:
        pytest.skip("Prometheus is not installed: apt-get install prometheus")
    wanted = "last_over_time(jouleswarm_energy_joules_total[1h])"
    found = json.loads(fetch(f"{watched.prometheus}/api/v1/query", query=f"sum by (arm, cause) ({wanted})"))
    by = {(each["metric"]["arm"], each["metric"]["cause"]): float(each["value"][1]) for each in found["data"]["result"]}
    summed = {
        (arm, cause): joules for arm in ARMS for cause, joules in watched.joules(arm).items() if (arm, cause) in by
    }
    assert by == pytest.approx(summed)
    for arm in ARMS:
        total = watched.run.summary["arms"][arm]["energy_j"]["literal"]["total"]
        assert sum(joules for (each, _), joules in by.items() if each == arm) == pytest.approx(total)
    assert {cause for _, cause in by} <= {cause.key for cause in CAUSES}
    done = json.loads(fetch(f"{watched.prometheus}/api/v1/query", query="last_over_time(jouleswarm_robots[1h])"))
    states = {each["metric"]["state"]: each["value"][1] for each in done["data"]["result"]}
    assert states == {"awaited": "0", "here": "0", "gone": "0", "done": "4"}


def test_names_are_as_prometheus_own_checker_wants_them(watched: Watched) -> None:
    if PROMTOOL is None:
        pytest.skip("promtool is not installed: apt-get install prometheus")
    told = subprocess.run([PROMTOOL, "check", "metrics"], input=watched.first_metrics, capture_output=True, text=True)
    assert (told.returncode, told.stdout + told.stderr) == (0, "")


def test_tensorboards_server_shows_rewards_and_the_bill(watched: Watched, starter: Any) -> None:
    url = f"http://127.0.0.1:{free_port()}"
    port = url.rpartition(":")[2]
    starter.python("tensorboard.main", "--logdir", str(watched.events), "--port", port, "--load_fast=false")
    scalars = f"{url}/data/plugin/scalars/scalars"

    def last(run: str, tag: str) -> tuple[int, float]:
        _, step, value = json.loads(fetch(scalars, run=run, tag=tag))[-1]
        return step, value

    def is_loaded() -> bool:
        with contextlib.suppress(OSError, urllib.error.HTTPError):
            return all(
                "bill/joules" in json.loads(fetch(f"{url}/data/plugin/scalars/tags"))[f"watched/{a}"] for a in ARMS
            )
        return False

    wait_until(is_loaded, "TensorBoard with both arms")
    for arm in ARMS:
        total = watched.run.summary["arms"][arm]["energy_j"]["literal"]["total"]
        assert last(f"watched/{arm}", "bill/joules") == (3, pytest.approx(total))
    (row,) = [row for row in watched.run.figures if (row["arm"], row["agent"], row["round"]) == ("fl", 1, 3)]
    assert last("watched/fl", "R/task-1") == (3, pytest.approx(row["cluster_reward"]))
    assert last("watched/maml", "stage/bits")[0] == 2  # told with the first row after the stage


def test_mlflows_server_has_a_finished_run_for_each_arm(watched: Watched) -> None:
    from mlflow.tracking import MlflowClient

    client = MlflowClient(tracking_uri=watched.mlflow)
    experiment = client.get_experiment_by_name("toy")
    found = {each.info.run_name: each for each in client.search_runs([experiment.experiment_id])}
    assert set(found) == {"watched/maml", "watched/fl"}
    for arm in ARMS:
        logged, bill = found[f"watched/{arm}"], watched.run.summary["arms"][arm]["energy_j"]
        assert logged.info.status == "FINISHED"
        assert (logged.data.params["meta.t0"], logged.data.params["federation.max_rounds"]) == ("2", "3")
        assert (logged.data.tags["jouleswarm.seed"], logged.data.tags["jouleswarm.arm"]) == ("1", arm)
        assert logged.data.metrics["bill/joules"] == pytest.approx(bill["literal"]["total"])
        assert logged.data.metrics["bill/sidelink"] == pytest.approx(bill["by_cause"]["sidelink"])
        steps = [each.step for each in client.get_metric_history(logged.info.run_id, "spent/joules")]
        assert steps == sorted(steps)
        assert len(client.get_metric_history(logged.info.run_id, "R/task-2")) >= 3
