"""What a run must still have to be gone on with."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.fleet.resume import check_is_there

PROCESSES = ("agent-1", "agent-2", "agent-3", "datacenter", "broker")
KEPT = {"datacenter": "counters.keys", "broker": "counters.keys"}


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Robots 1 and 2 and the data center have told rounds; robot 3, of another cluster, has not."""
    for name in PROCESSES:
        (tmp_path / "state" / name).mkdir(parents=True)
        (tmp_path / "state" / name / KEPT.get(name, "state.0")).touch()
    rows = [RoundRow(phase="fl", arm="maml", task=1, agent=agent, round=1, seconds=0.5) for agent in (2, 1, 0)]
    torn = b'{"phase": "fl", "agent": 3'
    (tmp_path / "rounds.jsonl").write_bytes("".join(row.model_dump_json() + "\n" for row in rows).encode() + torn)
    (tmp_path / "manifest.json").write_text(json.dumps({"broker": {"embedded": True}}))
    return tmp_path


@pytest.mark.parametrize("name", [name for name in PROCESSES if name != "agent-3"])
@pytest.mark.parametrize("how", ["gone", "emptied"])
def test_a_state_that_must_be_there_and_is_not_is_named(name: str, how: str, run: Path) -> None:
    check_is_there(run)
    (run / "state" / name / KEPT.get(name, "state.0")).unlink()
    if how == "gone":
        (run / "state" / name).rmdir()
    with pytest.raises(ConfigurationError, match=rf"state/{name}(/\S+)? is missing or empty"):
        check_is_there(run)


def test_who_has_told_nothing_may_begin_anew_and_an_external_broker_keeps_its_own_state(run: Path) -> None:
    (run / "state" / "agent-3" / "state.0").unlink()
    (run / "state" / "broker" / "counters.keys").unlink()
    (run / "manifest.json").write_text(json.dumps({"broker": {"embedded": False}}))
    check_is_there(run)


def test_before_the_first_round_nothing_must_be_there(run: Path) -> None:
    (run / "rounds.jsonl").unlink()
    for name in PROCESSES:
        (run / "state" / name / KEPT.get(name, "state.0")).unlink()
    check_is_there(run)
