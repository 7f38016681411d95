"""A run in MLflow, while it goes on (report/live_mlflow.py) and afterwards: one there for each arm, with the scenario
as parameters and its series as metrics."""

from __future__ import annotations

import importlib.util
import json
import logging
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.report.arms import labels
from jouleswarm.report.scalars import Scalar, scalars
from jouleswarm.runs.run import Run

T = TypeVar("T")
_RUN, _ARM = "jouleswarm.run", "jouleswarm.arm"
_MOST_PARAMS, _MOST_METRICS = 100, 1000  # of one call
_MOST_TEXT = 500  # of a parameter
_SETTINGS = {
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",  # else a wrong address is told after minutes
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "10",
    "MLFLOW_DISABLE_TELEMETRY": "true",  # nothing leaves for anywhere but the address that was named
}


def check_installed(option: str) -> None:
    """Without loading it, which takes seconds.

    Raises:
        ConfigurationError: MLflow is not installed.
    """
    if importlib.util.find_spec("mlflow") is None:
        raise ConfigurationError(f"{option} needs MLflow: pip install jouleswarm[mlflow]")


class Store:
    """The experiment that is called as the scenario, at an address. Its methods raise whatever MLflow raises."""

    def __init__(self, uri: str, scenario: Scenario, run: str) -> None:
        for name, value in _SETTINGS.items():
            os.environ.setdefault(name, value)
        from mlflow.tracking import MlflowClient

        for name in ("mlflow", "alembic"):
            logging.getLogger(name).setLevel(logging.WARNING)
        self._client: Any = MlflowClient(tracking_uri=uri)
        self._scenario, self._run = scenario, run
        found = self._client.get_experiment_by_name(scenario.name)
        self._experiment = found.experiment_id if found else self._client.create_experiment(scenario.name)

    def known(self) -> dict[str, str]:
        """Arm -> id, of what is there of this run."""
        found = self._client.search_runs([self._experiment], f"tags.`{_RUN}` = '{self._run}'")
        return {each.data.tags[_ARM]: each.info.run_id for each in found}

    def begin(self, arm: str, version: str, began_ms: int | None = None) -> str:
        """A new run of an arm, and what it was run with; gives its id."""
        from mlflow.entities import Param

        tags = {_RUN: self._run, _ARM: arm, "jouleswarm.label": labels(self._scenario)[arm]}
        tags |= {"jouleswarm.seed": str(self._scenario.seed), "jouleswarm.version": version}
        made = self._client.create_run(self._experiment, start_time=began_ms, tags=tags, run_name=f"{self._run}/{arm}")
        settings = _flat("", self._scenario.model_dump(mode="json"))
        params = [Param(key, value[:_MOST_TEXT]) for key, value in settings]
        for some in _parts(params, _MOST_PARAMS):
            self._client.log_batch(made.info.run_id, params=some)
        return str(made.info.run_id)

    def go_on(self, logged: str) -> None:
        """With one that was there."""
        self._client.set_terminated(logged, "RUNNING")

    def add(self, logged: str, series: Iterable[Scalar]) -> None:
        """Values of a run."""
        from mlflow.entities import Metric

        metrics = [Metric(each.name, each.value, int(1e3 * each.time_s), each.round) for each in series]
        for some in _parts(metrics, _MOST_METRICS):
            self._client.log_batch(logged, metrics=some)

    def end(self, logged: str, status: str, ended_ms: int | None = None) -> None:
        """FINISHED, FAILED or KILLED."""
        self._client.set_terminated(logged, status, ended_ms)


def log_run(run: Run, uri: str) -> list[str]:
    """Put each arm into the experiment that is called as the scenario; gives the runs' names there.

    Raises:
        ConfigurationError: MLflow is not installed, does not answer at `uri`, or has this run already.
    """
    check_installed("--to mlflow")
    from mlflow.exceptions import MlflowException

    try:
        store = Store(uri, run.scenario, run.name)
        if store.known():
            raise ConfigurationError(
                f"MLflow has {run.name} in its experiment {run.scenario.name} already; delete it there first"
            )
        for arm in run.scenario.arm_names:
            _log(store, run, arm)
    except MlflowException as error:
        raise ConfigurationError(f"--uri {uri}: MLflow: {str(error).splitlines()[0]}") from error
    return [f"{run.name}/{arm}" for arm in run.scenario.arm_names]


def _log(store: Store, run: Run, arm: str) -> None:
    series = list(scalars(run, arm))
    times_ms = [int(1e3 * each.time_s) for each in series if each.time_s]
    version = str(run.manifest.get("versions", {}).get("jouleswarm", ""))
    logged = store.begin(arm, version, min(times_ms, default=None))
    store.add(logged, series)
    store.end(logged, "FINISHED" if run.status == "complete" else "FAILED", max(times_ms, default=None))


def _flat(place: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping) and value:
        for key, each in value.items():
            yield from _flat(f"{place}.{key}" if place else str(key), each)
    elif value is not None:
        yield place, value if isinstance(value, str) else json.dumps(value)


def _parts(every: Sequence[T], most: int) -> Iterator[Sequence[T]]:
    for at in range(0, len(every), most):
        yield every[at : at + most]
