"""A window that shows pictures as they come, by pygame."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.error import DependencyNotInstalled


class Window:
    """Opens with the first picture; a picture stays for 1 / fps seconds.

    Raises:
        gymnasium.error.DependencyNotInstalled: there is no pygame.
    """

    def __init__(self, fps: float) -> None:
        try:
            import pygame
        except ModuleNotFoundError:
            raise DependencyNotInstalled(
                'render_mode "human" needs pygame, which is not installed: pip install "jouleswarm[render]"'
            ) from None
        self._pygame, self._fps = pygame, fps
        self._screen: Any = None

    def show(self, picture: npt.NDArray[np.uint8]) -> None:
        """Show uint8 [height, width, 3]; waits until the one before was seen."""
        pygame = self._pygame
        size = picture.shape[1], picture.shape[0]
        if self._screen is None:
            pygame.display.init()
            pygame.display.set_caption("JouleSwarm: camera and map")
            self._clock = pygame.time.Clock()
        if self._screen is None or self._screen.get_size() != size:
            self._screen = pygame.display.set_mode(size)
        self._screen.blit(pygame.image.frombuffer(np.ascontiguousarray(picture).tobytes(), size, "RGB"), (0, 0))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close the window; another picture would open it again."""
        if self._screen is not None:
            self._pygame.display.quit()
            self._screen = None
