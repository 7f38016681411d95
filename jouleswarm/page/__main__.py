"""The page beside `jouleswarm run --page`: PATH DESCRIPTOR, a socket that listens. Ends with standard input."""

from __future__ import annotations

import os
import socket
import sys
from pathlib import Path

from jouleswarm.common.process import process
from jouleswarm.page.serve import serve
from jouleswarm.page.source import Folder

_NICER = 10  # than the run, which the page must not slow down


def main() -> None:
    """Serve."""
    os.nice(_NICER)
    path, descriptor = sys.argv[1:]
    with process("page"):
        serve(Folder(Path(path)), socket.socket(fileno=int(descriptor)), None, with_parent=True)


if __name__ == "__main__":
    main()
