"""For all tests: arithmetic as in the processes of a run, on one thread and with denormals flushed.

Results in this process are then those of a run's processes to the bit, and small tensors are not slowed down by a
pool of threads that wait for each other.
"""

from __future__ import annotations

import pytest

from common.process import use_one_thread


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    use_one_thread()
