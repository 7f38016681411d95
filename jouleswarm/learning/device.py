"""Where the data center computes, and what is done so that the same numbers come out each time."""

from __future__ import annotations

import logging
import os

import torch

log = logging.getLogger("jouleswarm.datacenter")

_WORKSPACE = "CUBLAS_WORKSPACE_CONFIG"
_DETERMINISTIC_WORKSPACES = (":4096:8", ":16:8")


def accelerator() -> str | None:
    """Name of the CUDA device that is used; None without one."""
    return f"CUDA {torch.version.cuda} on {torch.cuda.get_device_name()}" if torch.cuda.is_available() else None


def accelerator_uuid() -> str | None:
    """What NVML knows that device by, without `GPU-`; None without one."""
    return str(torch.cuda.get_device_properties().uuid) if torch.cuda.is_available() else None


def compute_device() -> torch.device:
    """A CUDA device where there is one, else the processor.

    With CUDA the deterministic kernels are chosen, before the first of them runs. An operation that has none is still
    computed, and PyTorch warns of it in the process's log: then equal runs may differ in their last bits.
    """
    name = accelerator()
    if name is None:
        return torch.device("cpu")
    if os.environ.get(_WORKSPACE) not in _DETERMINISTIC_WORKSPACES:
        os.environ[_WORKSPACE] = _DETERMINISTIC_WORKSPACES[0]
    torch.backends.cudnn.benchmark = False
    torch.backends.cudnn.deterministic = True
    torch.use_deterministic_algorithms(True, warn_only=True)
    log.info("computing with deterministic kernels of %s; without it, or on another, weights differ", name)
    return torch.device("cuda")
