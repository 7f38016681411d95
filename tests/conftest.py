"""For all tests: arithmetic on one thread, as in the processes of a run.

Small tensors are slowed down tenfold by a pool of threads that wait for each other and for the cores.
"""

from __future__ import annotations

from pathlib import Path

import hypothesis
import pytest
import torch

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.fleet.keys import make_keys
from tests.made_up_run import facts, write_run  # noqa: F401 -- fixtures of several rooms' tests

# A machine that has much to do is slow, which is no fault of the code: no example has a time limit.
hypothesis.settings.register_profile("no deadline", deadline=None)
hypothesis.settings.load_profile("no deadline")

TOY = Path(__file__).parents[1] / "scenarios" / "toy.toml"


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of keys for the toy scenario: task 1 with robots 1 and 2, task 2 with robots 3 and 4."""
    folder = tmp_path_factory.mktemp("access") / "keys"
    make_keys(load_scenario(TOY), folder, ["localhost", "127.0.0.1"], days=2)
    return folder
