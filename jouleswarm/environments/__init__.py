"""Worlds to learn in. Importing this registers `jouleswarm/Landmarks-v0` with Gymnasium."""

import gymnasium

gymnasium.register(
    id="jouleswarm/Landmarks-v0", entry_point="jouleswarm.environments.landmarks.environment:LandmarksEnv"
)
