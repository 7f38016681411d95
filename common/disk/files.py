"""Files written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from jouleswarm.common.disk.trouble import disk_error
from jouleswarm.common.wire.types import Payload


def write_whole(path: Path, content: Payload, *, durable: bool = True) -> None:
    """Replace a file by `content`, whole or not at all; `durable`: not before it is on the disk.

    Raises:
        RunError: it cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        with part.open("wb") as file:
            file.write(content)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        part.replace(path)
        if durable:
            sync(path.parent)
    except OSError as error:
        if part.is_file():
            part.unlink()
        raise disk_error(path, error, len(content)) from error


def sync(path: Path) -> None:
    """Have a file or folder on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
