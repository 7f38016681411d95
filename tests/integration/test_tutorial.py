"""The tutorial, typed as it is printed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial.md"


@pytest.mark.timeout(400)
def test_every_command_of_the_tutorial_works_as_printed_and_shows_what_it_promises(tmp_path: Path) -> None:
    typed = "".join(re.findall(r"```sh\n(.*?)```", TUTORIAL.read_text(), re.S))
    assert typed.count("jouleswarm ") == 11
    found = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euc", typed],
        cwd=tmp_path,
        env=os.environ | {"PATH": found, "COLUMNS": "80"},
        capture_output=True,
        text=True,
        timeout=300,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stderr + done.stdout
    assert "At these prices" in done.stdout
    assert 'federation.codec: A "float32", B "int8"' in done.stdout
    assert {path.name for path in (tmp_path / "runs").iterdir()} == {"first", "second"}
    # gradients: 10 robots x 50 batches x 120 rounds x T_k P_k, 0.4 s x 5.1 W; then 90 rounds at 0.05 s x 12 W
    assert "122.4 kJ" in done.stdout
    assert " 27 kJ" in done.stdout
