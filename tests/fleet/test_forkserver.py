"""What the fork server has loaded before it forks, and what it must not have begun."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from jouleswarm.common.errors import RunError
from jouleswarm.fleet.launcher import Launcher

CODE = """
import gc, json, os, sys
from jouleswarm.fleet.forkserver import load
load()
threads, kept, before = len(os.listdir("/proc/self/task")), gc.get_freeze_count(), set(sys.modules)

from jouleswarm.agents.explorer import Explorer
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.learning.learner import Learner
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.learning.start import start_weights
from jouleswarm.methods.trial import try_learning

use_one_thread()
scenario = load_scenario("toy", ["methods=['fl']"])
explorer, weights = Explorer(scenario, 1), start_weights(scenario, 1)
learner = Learner(build_qnetwork(scenario), scenario.learning, weights, explorer._rng)
explorer.begin("fl", (1, 2))
explorer.collect(learner, 20)
learner.learn(1)
try_learning(scenario)
after = sorted(set(sys.modules) - before)
print(json.dumps({"threads": threads, "kept": kept, "before": sorted(before), "after": after}))
"""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}  # as the launcher has it


def test_the_fork_server_has_what_a_robot_needs_and_no_thread() -> None:
    environment = {**os.environ, **ONE_THREAD}
    done = subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert found["threads"] == 1  # of others a forked process would have nothing but their locks
    assert found["kept"] > 100_000  # objects that no collection looks at
    assert {"torch", "cv2", "paho.mqtt.client", "jouleswarm.datacenter.center"} <= set(found["before"])
    assert not {"torch._dynamo", "matplotlib", "pandas", "nicegui", "mlflow", "scipy.stats"} & set(found["before"])
    # A robot that learns loads next to nothing more: 48 robots would load it 48 times.
    assert not [name for name in found["after"] if name.startswith("jouleswarm")]
    assert len(found["after"]) < 10, found["after"]


SHARED = """
import os
from jouleswarm.fleet.forkserver import load
load("quick")
assert len(os.listdir("/proc/self/task")) == 1

import jouleswarm.environments.landmarks.drawing as drawing
from jouleswarm.common.scenario.reading import load_scenario

def cast(*_):
    raise AssertionError("a landmark was drawn again")

drawing.cast = cast
scenario = load_scenario("quick")
kept = scenario.spaces.observation.kept(scenario.network).shape
for task in scenario.clusters:
    env = scenario.make(task).unwrapped
    for size in (None, kept):
        assert env.show_as(size)
        for start in env.start("anywhere", 0, 1):
            env.reset(seed=1, options=start)
"""


def test_what_robots_see_is_drawn_before_they_are_forked() -> None:
    subprocess.run([sys.executable, "-c", SHARED], env={**os.environ, **ONE_THREAD}, check=True)


def test_an_environment_that_fails_to_share_is_told_in_a_line_before_any_process_runs(tmp_path: Path) -> None:
    (tmp_path / "theirs.py").write_text(
        "import gymnasium\n"
        "class Factory:\n"
        "    def __call__(self): return gymnasium.make('CartPole-v1')\n"
        "    def share(self, scenario): raise ValueError('no room' + chr(10) + 'for it')\n"
        "made = Factory()\n"
    )
    scenario = tmp_path / "theirs.toml"
    scenario.write_text('name = "theirs"\nenvironment = "theirs:made"\nmethods = ["fl"]\n[[tasks]]\nid = 1\n')
    with Launcher(tmp_path / "logs", scenario=scenario) as launcher:
        with pytest.raises(RunError) as error:
            launcher.start("agent-1", "jouleswarm.agents", ["--id", "1"])
        assert launcher.pids == {}
    told = "no process could be started: the fork server ended with code 2: fork server: environment 'theirs:made': "
    assert str(error.value).startswith(f"{told}share() fails: ValueError: no room (all of it: ")
