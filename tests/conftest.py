"""For all tests: arithmetic on one thread, as in the processes of a run.

Small tensors are slowed down tenfold by a pool of threads that wait for each other and for the cores.
"""

from __future__ import annotations

import pytest
import torch


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)
