"""How fast frames are made: the camera as it is, and the ray caster called for every frame.

    python -m benchmarks.rendering [--frames 1000] [--scenario scenarios/paper.toml]

One core. Each side is measured in the same run; the last line is the ratio.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from benchmarks.harness import parser, seconds
from jouleswarm.codecs.frames import resize
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.environments.landmarks.camera import Camera
from jouleswarm.environments.landmarks.scene import build_scene, cast
from jouleswarm.environments.landmarks.settings import camera_of, shared_obstacles, world_of


def per_second(work: Callable[[int], object], count: int) -> float:
    """Calls of work(0), work(1), ... a second."""
    return count / seconds(lambda: [work(index) for index in range(count)])


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--frames", type=int, default=1000)
    known.add_argument("--scenario", default="scenarios/paper.toml")
    options = known.parse_args()
    cv2.setNumThreads(1)
    scenario = load_scenario(options.scenario)
    world, settings, network = world_of(scenario), camera_of(scenario), scenario.network
    cells = [(r, c) for r in range(world.rows) for c in range(world.cols)]
    rng = np.random.default_rng(0)

    camera = Camera(world, settings, shared_obstacles(scenario))
    cold_s = seconds(lambda: [camera.frame(cell, rng) for cell in cells])

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
