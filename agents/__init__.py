"""The robot: a process that moves, learns and talks to its neighbours."""
