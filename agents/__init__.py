"""The robot: its world, camera, learner and the process that ties them together.

Importing this package registers the environment `jouleswarm/Landmarks-v0` with Gymnasium.
"""

import gymnasium

gymnasium.register(id="jouleswarm/Landmarks-v0", entry_point="agents.environment:LandmarksEnv")
