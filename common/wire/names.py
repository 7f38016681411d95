"""Plain names of clients on the bus."""

from __future__ import annotations

from collections.abc import Iterable


def client_of(agent: int) -> str:
    """Plain name of a process; robot 0 is the data center."""
    return f"agent-{agent}" if agent else "datacenter"


def clients_of(agents: Iterable[int]) -> list[str]:
    """Those of several."""
    return [client_of(agent) for agent in agents]
