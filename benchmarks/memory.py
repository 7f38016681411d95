"""Memory of a paper-size deployment: each robot's share before replay, and the whole at its peak.

    python -m benchmarks.memory [--rounds 3]

PSS (proportional set size, from Linux's smaps_rollup) counts a page that n processes share as 1/n in each, so
that sums over processes are real memory. USS is what a process has for itself alone.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import psutil

from benchmarks.harness import parser
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Presence, decode_json
from jouleswarm.fleet.launcher import Launcher

SCENARIO = "scenarios/paper.toml"
SAMPLE_S = 0.5


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--rounds", type=int, default=3, help="MAML rounds and FL rounds of the peak's run")
    rounds = known.parse_args().rounds
    overrides = [f"meta.t0={rounds}", "meta.snapshots=[]", f"federation.max_rounds={rounds}", 'methods=["maml"]']
    overrides += ["federation.target_reward=1e9"]
    scenario = load_scenario(SCENARIO, overrides)
    with tempfile.TemporaryDirectory() as folder, Launcher(Path(folder)) as launcher:
        url = launcher.start_broker()["url"]
        bus = MqttBus.connect(url, "onlooker")
        bus.subscribe(topics.presence("memory", "+", "+"))
        options = ["--broker", url, "--run", "memory", "--scenario", str(Path(SCENARIO).resolve())]
        options += [part for each in overrides for part in ("--set", each)]
        for agent in scenario.agents:
            launcher.start(f"agent-{agent}", "jouleswarm.agents", ["--id", str(agent), *options])
        here: set[int] = set()
        while here != set(scenario.agents):
            message = bus.receive()
            assert message is not None
            if message.payload:
                here.add(decode_json(message.payload, Presence).agent)
        # All robots have their networks and wait for the data center: nothing is in replay yet.
        robots = [psutil.Process(pid) for name, pid in launcher.pids.items() if name != "broker"]
        shares = sorted(robot.memory_full_info().pss / 1e6 for robot in robots)
        own = sorted(robot.memory_full_info().uss / 1e6 for robot in robots)
        print(
            f"a robot before replay: PSS {shares[0]:.0f} to {shares[-1]:.0f} MB, USS {own[0]:.0f} to {own[-1]:.0f} MB"
        )

        launcher.start("datacenter", "jouleswarm.datacenter", options)
        peak = 0.0
        while any(robot.is_running() and robot.status() != psutil.STATUS_ZOMBIE for robot in robots):
            peak = max(peak, sum(_pss_mb(pid) for pid in launcher.pids.values()))
            launcher.check()
            bus.receive(SAMPLE_S)
        bus.close()
        print(f"{len(robots)} robots, data center and broker: {peak:.0f} MB at most (goal: 6000 MB)")


def _pss_mb(pid: int) -> float:
    try:
        return float(psutil.Process(pid).memory_full_info().pss) / 1e6
    except psutil.Error:
        return 0.0


if __name__ == "__main__":
    main()
