"""How fast frames are made: the camera as it is, and the ray caster called for every frame.

    python -m benchmarks.rendering [--frames 1000] [--scenario scenarios/paper.toml]

One core. Each side is measured in the same run; the last line is the ratio.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import cv2
import numpy as np

from jouleswarm.codecs.frames import resize
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.environments.landmarks.camera import Camera
from jouleswarm.environments.landmarks.scene import build_scene, cast
from jouleswarm.environments.landmarks.settings import camera_of, shared_obstacles, world_of


def per_second(work: Callable[[int], object], count: int) -> float:
    """Calls of work(0), work(1), ... a second."""
    begun = time.perf_counter()
    for index in range(count):
        work(index)
    return count / (time.perf_counter() - begun)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--scenario", default="scenarios/paper.toml")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    scenario = load_scenario(options.scenario)
    world, settings, network = world_of(scenario), camera_of(scenario), scenario.network
    cells = [(r, c) for r in range(world.rows) for c in range(world.cols)]
    rng = np.random.default_rng(0)

    begun = time.perf_counter()
    camera = Camera(world, settings, shared_obstacles(scenario))
    for cell in cells:
        camera.frame(cell, rng)
    cold_s = time.perf_counter() - begun

    scene = build_scene(world.rows, world.cols, shared_obstacles(scenario))

    def frame(index: int) -> np.ndarray:
        return camera.frame(cells[index % len(cells)], rng)

    def cast_one(index: int) -> object:
        row, col = cells[index % len(cells)]
        return cast(scene, col, row, settings.width, settings.height, settings.width / 2)

    frames = per_second(frame, options.frames)
    resized = per_second(lambda index: resize(frame(index), network.width, network.height), options.frames)
    direct = per_second(cast_one, max(1, options.frames // 20))

    print(f"cold start, all {len(cells)} landmarks  {cold_s:8.2f} s")
    print(f"frames {settings.width}x{settings.height}x4             {frames:8.0f} /s")
    print(f"frames, resized to {network.width}x{network.height}    {resized:8.0f} /s")
    print(f"ray casting each frame       {direct:8.0f} /s")
    print(f"camera / ray casting         {frames / direct:8.1f} x")


if __name__ == "__main__":
    main()
