"""What is told of a run while it goes on, as options name it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jouleswarm.fleet.following import Follower, Following


@contextlib.contextmanager
def followed(
    metrics_port: int | None, tensorboard: Path | None, mlflow: str | None, metrics_host: str = "127.0.0.1"
) -> Iterator[Following]:
    """Whoever is named, ready before anything is started, and closed at the end.

    Raises:
        ConfigurationError: an address is in use, a folder cannot be written into, or an extra is not installed.
    """
    from jouleswarm.fleet.following import following

    followers: list[Follower] = []
    if metrics_port is not None:
        from jouleswarm.fleet.metrics import Metrics

        followers.append(Metrics(metrics_port, metrics_host))
    if tensorboard is not None:
        from jouleswarm.report.tensorboard import LiveEvents

        followers.append(LiveEvents(tensorboard))
    if mlflow is not None:
        from jouleswarm.report.live_mlflow import LiveRuns

        followers.append(LiveRuns(mlflow))
    with following(followers) as found:
        yield found
