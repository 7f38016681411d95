"""How the C library treats the memory of messages and tensors that have gone."""

from __future__ import annotations

import ctypes

# From <malloc.h> of glibc; see mallopt(3).
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
_MMAP_THRESHOLD_MAX_BYTES = 32 * 1024 * 1024
_KEPT_BYTES = 256 * 1024 * 1024


def keep_freed_memory(limit_bytes: int = _KEPT_BYTES) -> bool:
    """Keep up to `limit_bytes` of freed memory for what comes next; False where the C library cannot.

    glibc gives a large buffer back to the kernel when it is freed, and the next message pays for it with a
    page fault every 4 KB: some 29 000 in one exchange of 12 robots, a quarter of the broker's time. So it is with a
    batch of frames in the data center, a third of its time at full size.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    kept = mallopt(_M_TRIM_THRESHOLD, min(limit_bytes, 2**31 - 1))
    mapped = mallopt(_M_MMAP_THRESHOLD, _MMAP_THRESHOLD_MAX_BYTES)
    return bool(kept and mapped)
