"""Each fault does to a deployment what it says: here to stand-ins for its processes."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from jouleswarm.chaos.faults import Site, inject, refused
from jouleswarm.common.disk.lock import Lock
from jouleswarm.common.disk.state import State
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.runs.directory import RunDirectory
from jouleswarm.runs.manifest import manifest

TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"
DEADLINE_S = 60.0
ROBOT = ('methods=["fl"]',)  # no data center: all that is done is done to a robot

WRITER = """
import sys
with open(sys.argv[1], "wb") as file:
    print("begun", flush=True)
    sys.stdin.readline()
    try:
        file.write(bytes(20_000)); file.flush()
    except OSError as error:
        print(error.errno, flush=True)
        file.truncate(0)
"""


class Deployment:
    """Robots 1 to 4, played by one process."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.process = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path / "file")], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert self.process.stdout is not None
        assert self.process.stdin is not None
        self.said, self.told = self.process.stdout, self.process.stdin
        assert self.said.readline() == b"begun\n"
        launcher = SimpleNamespace(pids={f"agent-{agent}": self.process.pid for agent in (1, 2, 3, 4)})
        options = ["--scenario", str(TOY), "--set", *ROBOT]
        nobody = cast("Any", None)
        others: tuple[Any, ...] = ("mqtt://127.0.0.1:1", "r", options, 1.0, random.Random(1), nobody, path)
        self.site = Site(load_scenario(TOY, ROBOT), cast("Any", launcher), nobody, *others)


@pytest.fixture
def deployment(tmp_path: Path) -> Iterator[Deployment]:
    made = Deployment(tmp_path)
    yield made
    made.process.kill()
    made.process.communicate()
    for twin in made.site.twins:
        twin.kill()
        twin.wait()


def states(path: Path) -> dict[str, StateFile]:
    """Of all four robots, who have done a round."""
    held = {f"agent-{agent}": path / "state" / f"agent-{agent}" / "state" for agent in (1, 2, 3, 4)}
    for file in held.values():
        StateFile(file, "r").save(State(values={"round": 1}))
    return {name: StateFile(file, "r") for name, file in held.items()}


def test_a_torn_state_is_of_a_process_that_is_killed_and_leads_back_to_the_round_before(deployment: Deployment) -> None:
    held = states(deployment.path)
    before = {name: (deployment.path / "state" / name / "state.1").read_bytes() for name in held}
    torn = inject("state torn", deployment.site)
    assert torn is not None
    assert deployment.process.wait(DEADLINE_S) == -signal.SIGKILL
    changed = {name for name in held if (deployment.path / "state" / name / "state.1").read_bytes() != before[name]}
    assert changed <= {torn}
    assert held[torn].load() == State(values={"round": 1})


def test_without_a_disk_of_its_own_no_file_of_a_robot_may_grow(deployment: Deployment) -> None:
    assert str(inject("disk full", deployment.site)).startswith("agent-")
    deployment.told.write(b"\n")
    deployment.told.flush()
    assert deployment.said.readline() == b"27\n"  # EFBIG


def test_who_has_left_is_left_alone(deployment: Deployment) -> None:
    deployment.site.here = ("agent-3", "datacenter")
    assert inject("robot killed", deployment.site) == "agent-3"


def test_a_lost_state_is_one_of_a_robot_that_has_told_of_a_round(deployment: Deployment) -> None:
    assert inject("state lost", deployment.site) is None
    deployment.site.told = (3,)
    assert inject("state lost", deployment.site) == "agent-3"


def test_a_second_process_is_started_with_a_state_only_where_the_first_has_got_hold_of_it(
    deployment: Deployment,
) -> None:
    assert inject("same state twice", deployment.site) is None
    assert deployment.site.twins == []
    for agent in (1, 2, 3, 4):
        folder = deployment.path / "state" / f"agent-{agent}"
        folder.mkdir(parents=True)
        (folder / ".lock").write_text(f"robot {agent}, process {deployment.process.pid} on here")
    name = inject("same state twice", deployment.site)
    (twin,) = deployment.site.twins
    assert isinstance(twin.args, list)
    assert twin.args[-2:] == ["--state", str(deployment.path / "state" / str(name))]


def test_a_run_that_is_going_on_is_refused_to_who_would_resume_it(deployment: Deployment) -> None:
    scenario, path = deployment.site.scenario, deployment.path / "r"
    RunDirectory(path, state=path / "state" / "recorder").manifest(manifest(scenario, "r", "mqtt://a", embedded=True))
    deployment.site.path = path
    with Lock(path, "jouleswarm run"):
        assert inject("same run twice", deployment.site) == "the run"
        assert refused(deployment.site.twins[0], wait=True)
