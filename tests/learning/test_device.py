"""With CUDA the deterministic kernels are chosen; there is no such device here, so the choice alone is tested."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
import torch

from jouleswarm.learning.device import accelerator, compute_device

WORKSPACE = "CUBLAS_WORKSPACE_CONFIG"


@pytest.fixture
def _cuda(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda: "Some GPU")
    monkeypatch.setattr(torch.version, "cuda", "13.0")
    monkeypatch.setattr(torch.backends.cudnn, "benchmark", True)
    monkeypatch.setattr(torch.backends.cudnn, "deterministic", False)
    monkeypatch.setenv(WORKSPACE, "unset")
    yield
    torch.use_deterministic_algorithms(False)


@pytest.mark.usefixtures("_cuda")
def test_with_cuda_the_deterministic_switches_are_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(WORKSPACE)
    assert compute_device() == torch.device("cuda")
    assert torch.are_deterministic_algorithms_enabled()
    assert torch.is_deterministic_algorithms_warn_only_enabled()
    assert torch.backends.cudnn.deterministic
    assert not torch.backends.cudnn.benchmark
    assert os.environ[WORKSPACE] == ":4096:8"
    assert accelerator() == "CUDA 13.0 on Some GPU"


@pytest.mark.usefixtures("_cuda")
@pytest.mark.parametrize(("given", "kept"), [(":16:8", ":16:8"), (":0:0", ":4096:8")])
def test_a_deterministic_workspace_of_the_users_is_kept(monkeypatch: pytest.MonkeyPatch, given: str, kept: str) -> None:
    monkeypatch.setenv(WORKSPACE, given)
    compute_device()
    assert os.environ[WORKSPACE] == kept


def test_without_cuda_nothing_is_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.delenv(WORKSPACE, raising=False)
    assert compute_device() == torch.device("cpu")
    assert accelerator() is None
    assert not torch.are_deterministic_algorithms_enabled()
    assert WORKSPACE not in os.environ
