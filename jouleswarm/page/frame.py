"""What every page does in the browser: built empty, filled when something is known, and again when that changes."""

from __future__ import annotations

from typing import Generic, TypeVar

from nicegui import ui

from jouleswarm.page.elements import fill, text
from jouleswarm.page.style import CSS
from jouleswarm.page.watch import Watch

_EVERY_S = 0.25
S = TypeVar("S")
"""What a watch finds."""


class Frame(Generic[S]):
    """One object a browser that has the page open."""

    def __init__(self, watch: Watch[S]) -> None:
        self.watch = watch
        self.shown: S | None = None
        ui.add_css(CSS)
        ui.colors(primary="#b06f00")
        with ui.element("main"):
            self._heading = text(self.heading(None))
            self._trouble = text("")
            self.top()
            self.body = ui.element("div")
        ui.timer(_EVERY_S, self.update)

    def heading(self, shown: S | None) -> str:
        """As HTML; before anything is known too."""
        raise NotImplementedError

    def top(self) -> None:
        """What stands above all else, still empty."""

    def build(self, shown: S) -> None:
        """The rest, inside `body`, once something is known."""
        raise NotImplementedError

    def fill(self, shown: S) -> None:
        """Show what is known."""
        raise NotImplementedError

    def update(self) -> None:
        """Show what has come since."""
        shown = self.watch.shown
        fill(self._trouble, self.watch.trouble)
        if shown is None or shown is self.shown:
            return
        if self.shown is None:
            with self.body:
                self.build(shown)
        self.shown = shown
        fill(self._heading, self.heading(shown))
        self.fill(shown)
