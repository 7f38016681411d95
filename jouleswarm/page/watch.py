"""What all open pages look at: the newest of the source, looked for in a thread beside them."""

from __future__ import annotations

import html
import logging
import threading
from typing import Generic, TypeVar

from jouleswarm.common.errors import JouleSwarmError
from jouleswarm.page.source import Source

_EVERY_S = 0.3

log = logging.getLogger("jouleswarm.page")

T = TypeVar("T")


class Watch(Generic[T]):
    """Context manager: the thread ends with it."""

    def __init__(self, source: Source[T]) -> None:
        self._source, self.title, self.where = source, source.title, source.where
        self.shown: T | None = None
        self.trouble = ""
        """Why there is nothing new, as HTML."""
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look_again, name="page", daemon=True)

    def __enter__(self) -> Watch[T]:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _look_again(self) -> None:
        try:
            while not self._ended.wait(_EVERY_S):
                self._look()
        finally:
            if not self._ended.is_set():  # a defect, whose traceback comes next
                self.trouble = _told("the page has failed: see what it printed")

    def _look(self) -> None:
        try:
            self.shown, self.trouble = self._source.look(), ""
        except (JouleSwarmError, OSError) as error:
            if not self.trouble:
                log.warning("%s", error)
            self.trouble = _told(str(error))


def _told(line: str) -> str:
    return f'<p class="answer">{html.escape(line)}</p>'
