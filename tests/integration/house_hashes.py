"""SHA-256 of what the toy scenario comes to, method by method, in this tree or in an older one.

    python -m tests.integration.house_hashes      adds this machine's, of the old commit, to house_hashes.json

It imports nothing of the house by itself, so that the same lines read every tree: names have changed, results may not.
"""

from __future__ import annotations

import hashlib
import importlib
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import safetensors.numpy

ROOT = Path(__file__).resolve().parents[2]
KEPT = Path(__file__).with_suffix(".json")
OLD = "ccc6cd1"
"""The newest commit that moved bits: a gradient step by hand."""

Hashes = dict[str, dict[str, str]]
"""Case -> {"rows", "weights"} -> SHA-256."""

# No robot can reach a target of 1000: every arm lasts its 5 rounds.
SHORT = ("federation.max_rounds=5", "federation.target_reward=1000", "meta.t0=2", "meta.snapshots=[1]")
# Defaults of today that were otherwise, or were not there, in the old commit.
SINCE = (
    *('learning.collect="own"', "learning.epsilon=0.1", 'learning.starts="area"'),
    *("meta.epsilon=0.6", 'meta.starts="anywhere"', "camera.draw=frame"),
)
CASES = {
    **{method: (f"methods=['{method}']",) for method in ("multitask", "fl", "fedavg", "centralized", "isolated")},
    "maml": ("methods=['maml']", "meta.adapt_from=[1]"),
    "topk": ("methods=['multitask','fl','fedavg']", "federation.codec='topk'"),
}
# Those of the old commit but `seconds` and `refused`, which depend on the clock and on what came twice.
COLUMNS = (
    "phase", "arm", "task", "agent", "round", "reward", "cluster_reward", "rmse_m", "gradients", "gradients_support",
    "gradients_query", "beta", "experience_bytes", "learned", "missed",
)  # fmt: skip


def rows_hash(rows: Iterable[Mapping[str, Any]]) -> str:
    """Of the rows of rounds.jsonl, each as plain values."""
    lines = (json.dumps([row[column] for column in COLUMNS]) for row in rows)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def weights_hash(models: Mapping[tuple[str, str, int], bytes]) -> str:
    """Of all tensors of safetensors files, by name, type and shape; metadata may grow."""
    told = hashlib.sha256()
    for key, payload in sorted(models.items()):
        for name, tensor in sorted(safetensors.numpy.load(payload).items()):
            told.update(repr((key, name, str(tensor.dtype), tensor.shape)).encode())
            told.update(tensor.tobytes())
    return told.hexdigest()


def hashes(simulation: Any, reading: Any, scenario: str, case: str, since: Iterable[str] = ()) -> dict[str, str]:
    """What one case comes to; the modules are those of a tree."""
    outcome = simulation.run_in_memory(reading.load_scenario(scenario, [*SHORT, *CASES[case], *since]))
    models = {("learned", *key): payload for key, payload in outcome.learned.items()}
    models |= {("snapshot", *key): payload for key, payload in outcome.snapshots.items()}
    # Round 0 is newer than the old commit; that it changes no later round is what is held here.
    rows = [row.model_dump(mode="json") for row in outcome.rows if row.round]
    return {"rows": rows_hash(rows), "weights": weights_hash(models)}


def hashes_of_the_old_commit() -> Hashes | None:
    """From a run of the old commit on this machine; None where the history is not at hand."""
    try:
        archive = subprocess.run(["git", "archive", OLD], cwd=ROOT, capture_output=True, timeout=60)
    except FileNotFoundError:
        return None
    if archive.returncode:
        return None
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as tree:
            tree.extractall(folder, filter="data")
        names = ["jouleswarm.simulation", "jouleswarm.common.scenario.reading", "scenarios/toy.toml"]
        done = subprocess.run(
            [sys.executable, "-P", __file__, *names],
            cwd=folder, env={**os.environ, "PYTHONPATH": folder}, stdout=subprocess.PIPE, check=True, timeout=150,
        )  # fmt: skip
    found: Hashes = json.loads(done.stdout)
    return found


def main() -> None:
    """See the head of this file."""
    import torch

    torch.set_num_threads(1)
    if len(sys.argv) > 1:  # names in the tree that is looked at
        simulation, reading = (importlib.import_module(name) for name in sys.argv[1:3])
        print(json.dumps({case: hashes(simulation, reading, sys.argv[3], case) for case in CASES}))
        return
    from jouleswarm.common.host import arithmetic

    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    kept[arithmetic()] = hashes_of_the_old_commit()
    KEPT.write_text(json.dumps(kept, indent=1) + "\n")


if __name__ == "__main__":
    main()
