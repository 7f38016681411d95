"""The house of JouleSwarm: docs/architecture.md shows its rooms."""
