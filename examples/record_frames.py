"""Make recorded frames of landmarks, as a robot with two cameras would bring them: here it is drawn what they see.

python examples/record_frames.py examples/frames --rows 4 --cols 3 --width 64 --height 48

FOLDER/ROW-COL/NAME.png is the colour picture, NAME.depth.png its distances in millimetres (16 bit). Scenarios use them
with `camera.frames = "FOLDER"`; recorded.toml is one.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from jouleswarm.environments.landmarks.scene import build_scene, cast


def record(folder: Path, rows: int, cols: int, width: int, height: int, pictures: int, jitter: float) -> None:
    """`pictures` of each landmark, from poses within `jitter` cells (of 1 m) of it."""
    scene, rng = build_scene(rows, cols, frozenset()), np.random.default_rng(1)
    for row in range(rows):
        for col in range(cols):
            at = folder / f"{row}-{col}"
            at.mkdir(parents=True, exist_ok=True)
            for number in range(pictures):
                dx, dy = rng.uniform(-jitter, jitter, 2)
                colours, depth_m = cast(scene, col + dx, row + dy, width, height, focal=width / 2)
                cv2.imwrite(str(at / f"{number}.png"), colours[..., ::-1])  # OpenCV writes blue, green, red
                cv2.imwrite(str(at / f"{number}.depth.png"), np.rint(depth_m * 1000).clip(0, 65535).astype(np.uint16))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    for name, value in (("rows", 4), ("cols", 3), ("width", 64), ("height", 48), ("pictures", 2)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--jitter", type=float, default=0.03, help="metres")
    record(**vars(parser.parse_args()))


if __name__ == "__main__":
    main()
