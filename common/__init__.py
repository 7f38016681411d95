"""What two or more of JouleSwarm's processes share: scenario, topics, payloads, bus, network, energy."""
