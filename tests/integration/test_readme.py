"""The README's scenario and its five files, each by a door, as a reader would put them down and run them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

README = (Path(__file__).parents[2] / "README.md").read_text()


def files_of(text: str) -> dict[str, str]:
    """Every file in a block of code: each begins with a comment that has its name."""
    found = {}
    for block in re.findall(r"```(?:toml|python)\n(.*?)```", text, re.S):
        parts = re.split(r"(?m)^(?=# \w+\.(?:py|toml)\b)", block)
        found |= {name[1]: part for part in parts if (name := re.match(r"# (\w+\.\w+)", part))}
    return found


def test_what_the_readme_puts_together_runs_from_start_to_bill(start: Any, tmp_path: Path) -> None:
    files = files_of(README)
    assert set(files) == {"mine.toml", "corridor.py", "wide.py", "rules.py", "half.py", "cellular.py"}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    options = ("--out", str(tmp_path / "runs"), "--run-id", "mine", "--no-figures", "--set", "federation.max_rounds=3")
    ended = start.jouleswarm("run", str(tmp_path / "mine.toml"), *options)
    assert ended.ends() == 0, ended.printed
    summary = json.loads((tmp_path / "runs" / "mine" / "summary.json").read_text())
    assert set(summary["arms"]) == {"fl", "median"}
    for arm in summary["arms"].values():
        # 2 tasks, 2 directed links, at most 3 rounds; 7 x 256 + 256 + 256 x 2 + 2 = 2562 weights of 2 bytes
        sidelink = arm["bytes"]["sidelink"]
        assert 0 < sidelink["messages"] <= 12
        assert 5_124 * sidelink["messages"] < sidelink["payload"] < 7_000 * sidelink["messages"]
    assert sorted(each.name for each in (tmp_path / "runs" / "mine" / "doors").iterdir()) == sorted(
        name for name in files if name.endswith(".py")
    )


def test_the_lines_for_a_notebook_run_as_they_stand(tmp_path: Path) -> None:
    (lines,) = (block for block in re.findall(r"```python\n(.*?)```", README, re.S) if "import Run, run" in block)
    short = lines.replace("seed=3", 'seed=3, set={"federation.max_rounds": 2, "meta.t0": 1}')
    asked = short.replace("done.bill() /", "ratio = done.bill() /")
    assert len({lines, short, asked}) == 3
    asked += "print(done.status, ratio.loc['maml', ('ml', 'uplink')])"
    done = subprocess.run([sys.executable, "-c", asked], cwd=tmp_path, capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "complete 2.5"  # 200 kb/J in place of 500
