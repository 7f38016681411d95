"""A fork server like that of `jouleswarm.fleet.forkserver`, whose robots stop at their first round (see `startup`).

    python -P benchmarks/first_round.py CHECKOUT DESCRIPTOR PARENT FILE

It runs what is in the folder CHECKOUT. FILE gets a line of each process: who, and the seconds of CPU time that it had
spent: the server when it had loaded all, a robot when its first round began.
"""

from __future__ import annotations

import socket
import sys
import time
from typing import Any


def main() -> None:
    checkout, descriptor, parent, told = sys.argv[1:]
    sys.path.insert(0, checkout)
    from jouleswarm.fleet import forkserver

    def tell(who: str) -> None:
        with open(told, "a", encoding="utf-8") as file:
            file.write(f"{who} {time.process_time()}\n")

    def at_first_round(*_: Any) -> None:
        tell("robot")
        time.sleep(3600.0)  # until it is ended with the server

    def serve(launcher: socket.socket) -> Any:
        tell("server")
        from jouleswarm.agents import robot

        robot.Robot._rounds = at_first_round  # type: ignore[assignment, method-assign]
        return before(launcher)

    before, forkserver.serve = forkserver.serve, serve
    sys.argv = [sys.argv[0], descriptor, parent]
    forkserver.main()


if __name__ == "__main__":
    main()
