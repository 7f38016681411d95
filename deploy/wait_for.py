"""Wait until somebody listens: python -S deploy/wait_for.py HOST PORT.

What `depends_on` is to Compose: a cluster's name of a service leads nowhere before its health check passes, so who
waits for the recorder here sends nothing that it would miss. Standard library only. Ends with the container.
"""

from __future__ import annotations

import socket
import sys
import time

TIMEOUT_S, PAUSE_S = 3.0, 0.5


def wait_for(host: str, port: int) -> None:
    """Come back once a connection was taken; a name that is not known yet is waited for too."""
    while True:
        try:
            socket.create_connection((host, port), TIMEOUT_S).close()
        except OSError:
            time.sleep(PAUSE_S)
        else:
            return


if __name__ == "__main__":
    wait_for(sys.argv[1], int(sys.argv[2]))
