"""A corridor of `length` cells: the door is at the right end for one task, at the left for another."""

import gymnasium as gym
import numpy as np


class Corridor(gym.Env):
    """Observations are float32 [length], 1 where the robot stands; actions are 0 left, 1 right."""

    def __init__(self, length=7, right=True):
        self.length, self.goal = length, length - 1 if right else 0
        self.observation_space = gym.spaces.Box(0, 1, (length,), np.float32)
        self.action_space = gym.spaces.Discrete(2)

    def _see(self):
        return np.eye(self.length, dtype=np.float32)[self.at]

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at, self.moves = self.length // 2, 0
        return self._see(), {}

    def step(self, action):
        self.at = min(max(self.at + 2 * int(action) - 1, 0), self.length - 1)
        self.moves += 1
        done = self.at == self.goal
        return self._see(), 10.0 * done - 0.1, done, self.moves >= 20, {}
