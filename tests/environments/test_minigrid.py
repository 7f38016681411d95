"""MiniGrid, opened by several robots of one process at once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

GATES = "import threading\nis_half_there, may_go_on = threading.Event(), threading.Event()\n"
PACKAGE = """
from minigrid import wrappers
import gates
gates.is_half_there.set()
gates.may_go_on.wait(60)
from gymnasium.envs.registration import register
register("Late-v0", entry_point="gymnasium.envs.classic_control.cartpole:CartPoleEnv")
"""
WRAPPERS = """
ImgObsWrapper = lambda env: env
RGBImgPartialObsWrapper = lambda env, tile_size: env
"""
SCRIPT = """
import threading, gates
from jouleswarm.environments.minigrid import minigrid
found = []
first = threading.Thread(target=lambda: __import__("minigrid"))
second = threading.Thread(target=lambda: found.append(minigrid("Late-v0", actions=2)))
first.start()
gates.is_half_there.wait(60)
second.start()
second.join(0.5)  # whoever does not wait has failed by then
gates.may_go_on.set()
second.join(60)
assert len(found) == 1
"""


def test_a_robot_waits_until_another_has_imported_minigrid_to_its_end(tmp_path: Path) -> None:
    (tmp_path / "minigrid").mkdir()
    (tmp_path / "minigrid" / "__init__.py").write_text(PACKAGE)
    (tmp_path / "minigrid" / "wrappers.py").write_text(WRAPPERS)
    (tmp_path / "gates.py").write_text(
        "import threading\nis_half_there, may_go_on = threading.Event(), threading.Event()\n"
    )
    code = f"import sys\nsys.path.insert(0, {str(tmp_path)!r})\n{SCRIPT}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
