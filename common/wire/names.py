"""Plain names of clients on the bus."""

from __future__ import annotations


def client_of(agent: int) -> str:
    """Plain name of a process; robot 0 is the data center."""
    return f"agent-{agent}" if agent else "datacenter"
