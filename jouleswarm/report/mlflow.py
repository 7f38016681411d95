"""A run in MLflow: one there for each arm, with the scenario as parameters and its series as metrics."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.report.arms import labels
from jouleswarm.report.scalars import scalars
from jouleswarm.runs.run import Run

T = TypeVar("T")
_RUN = "jouleswarm.run"
_MOST_PARAMS, _MOST_METRICS = 100, 1000  # of one call
_MOST_TEXT = 500  # of a parameter


def log_run(run: Run, uri: str) -> list[str]:
    """Put each arm into the experiment that is called as the scenario; gives the runs' names there.

    Raises:
        ConfigurationError: MLflow is not installed, does not answer at `uri`, or has this run already.
    """
    try:
        from mlflow.exceptions import MlflowException
        from mlflow.tracking import MlflowClient
    except ImportError as error:
        raise ConfigurationError("--to mlflow needs it: pip install jouleswarm[mlflow]") from error
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "2")  # else a wrong address is told after minutes
    logging.getLogger("mlflow").setLevel(logging.WARNING)
    name = run.scenario.name
    try:
        client = MlflowClient(tracking_uri=uri)
        found = client.get_experiment_by_name(name)
        experiment = found.experiment_id if found else client.create_experiment(name)
        if client.search_runs([experiment], f"tags.`{_RUN}` = '{run.name}'", max_results=1):
            raise ConfigurationError(f"MLflow has {run.name} in its experiment {name} already; delete it there first")
        return [_log(client, experiment, run, arm) for arm in run.scenario.arm_names]
    except MlflowException as error:
        raise ConfigurationError(f"--uri {uri}: MLflow: {str(error).splitlines()[0]}") from error


def _log(client: Any, experiment: str, run: Run, arm: str) -> str:
    from mlflow.entities import Metric, Param

    series, name = list(scalars(run, arm)), f"{run.name}/{arm}"
    times_ms = [int(1e3 * each.time_s) for each in series]
    began_ms = min((each for each in times_ms if each), default=None)
    tags = {_RUN: run.name, "jouleswarm.arm": arm, "jouleswarm.label": labels(run.scenario)[arm]}
    logged = client.create_run(experiment, start_time=began_ms, tags=tags, run_name=name).info.run_id
    settings = [Param(key, value[:_MOST_TEXT]) for key, value in _flat("", run.scenario.model_dump(mode="json"))]
    for params in _parts(settings, _MOST_PARAMS):
        client.log_batch(logged, params=params)
    metrics = [Metric(each.name, each.value, at, each.round) for each, at in zip(series, times_ms, strict=True)]
    for some in _parts(metrics, _MOST_METRICS):
        client.log_batch(logged, metrics=some)
    status = "FINISHED" if run.status == "complete" else "FAILED"
    client.set_terminated(logged, status, max(times_ms, default=0) or None)
    return name


def _flat(place: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping) and value:
        for key, each in value.items():
            yield from _flat(f"{place}.{key}" if place else str(key), each)
    elif value is not None:
        yield place, value if isinstance(value, str) else json.dumps(value)


def _parts(every: Sequence[T], most: int) -> Iterator[Sequence[T]]:
    for at in range(0, len(every), most):
        yield every[at : at + most]
