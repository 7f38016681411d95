"""Stable-Baselines3 learns a task of the landmark world by itself: no bus, no bill, one process.

    pip install jouleswarm stable-baselines3
    python examples/sb3.py --motions 20000 --video videos/

Prints the mean return of ten episodes by the learned policy; `--video` leaves the first of them as an MP4, seen from
above.
"""

from __future__ import annotations

import argparse

import gymnasium
from gymnasium.wrappers import RecordVideo, ResizeObservation
from stable_baselines3 import DQN
from stable_baselines3.common.evaluation import evaluate_policy


def world(task: int, video: str | None = None) -> gymnasium.Env:
    """A task with its frames shrunk to 96 x 72, red, green, blue and depth."""
    made = gymnasium.make("jouleswarm.environments:jouleswarm/Landmarks-v0", task=task, render_mode="map")
    if video:
        made = RecordVideo(made, video, episode_trigger=lambda episode: episode == 0)
    return ResizeObservation(made, (72, 96))


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--task", type=int, default=1)
    arguments.add_argument("--motions", type=int, default=20_000)
    arguments.add_argument("--episodes", type=int, default=10)
    arguments.add_argument("--video")
    chosen = arguments.parse_args()
    model = DQN("CnnPolicy", world(chosen.task), learning_starts=100, buffer_size=5_000, seed=1)
    model.learn(chosen.motions)
    seen = world(chosen.task, chosen.video)
    mean, spread = evaluate_policy(model, seen, chosen.episodes, warn=False)
    seen.close()
    print(f"task {chosen.task}: return {mean:.1f} (standard deviation {spread:.1f}) after {chosen.motions} motions")


if __name__ == "__main__":
    main()
