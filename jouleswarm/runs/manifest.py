"""What a run says of itself before it begins."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
from typing import Any

from jouleswarm.common.bus.address import parse_url
from jouleswarm.common.host import machine
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.runs.interface import interface_of
from jouleswarm.runs.summary import SCHEMA

_PACKAGES = ("amqtt", "gymnasium", "numpy", "opencv-python-headless", "paho-mqtt", "safetensors", "torch")


def manifest(scenario: Scenario, run: str, url: str, *, embedded: bool) -> dict[str, Any]:
    """What `manifest.json` holds; on what each process computes comes with its presence."""
    return {
        "schema": SCHEMA,
        "run": run,
        "scenario": scenario.model_dump(mode="json"),
        "doors": scenario.digests,
        "interface": interface_of(scenario).model_dump(mode="json"),
        "seed": scenario.seed,
        "versions": {
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in ("jouleswarm", *_PACKAGES)},
        },
        "host": machine(),
        "started": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "broker": {"embedded": embedded, "url": str(parse_url(url))},  # without user and password
    }
