"""The card of price sliders."""

from __future__ import annotations

import html
from collections.abc import Callable, Sequence

from nicegui import ui

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.page import prices
from jouleswarm.page.elements import box, card, fill, text
from jouleswarm.report.sliders import Slider


class _Bar(ui.slider):
    LOOPBACK = False  # its position is the browser's: an answer that comes late would move it back


class Sliders:
    """Where they stand in one browser; what is moved is told at once, with the command that prints its bill."""

    def __init__(self, sliders: Sequence[Slider], own: Energy, where: str, on_move: Callable[[], None]) -> None:
        """
        Args:
            sliders: to show.
            own: constants that they begin at.
            where: the run, as `jouleswarm report` takes it; "" where there is none.
            on_move: called after each move.
        """
        self._sliders, self._own, self._where, self._on_move = sliders, own, where, on_move
        self.positions = {each.key: prices.position(each, own) for each in sliders}
        self._values: dict[str, ui.html] = {}
        self._bars: dict[str, ui.slider] = {}
        with card("Other prices: what was done stays, and is priced again at once", "wide"):
            with box("sliders"):
                for each in sliders:
                    self._build(each)
            with box("head"):
                ui.button("the run's own prices", on_click=self._reset).props("flat dense no-caps")
                self._command = text("")
        self._tell()

    def _build(self, each: Slider) -> None:
        low, high = prices.BOUNDS if each.is_factor else prices.CARBON_BOUNDS
        step = prices.STEP if each.is_factor else prices.CARBON_STEP
        with box("slider").props(f'data-key="{each.key}" title="{each.meaning}"'):
            text(each.symbol)
            self._values[each.key] = text("").classes("value")
            bar = _Bar(min=low, max=high, step=step, value=self.positions[each.key])
            bar.props(f'aria-label="{each.meaning}"')
            bar.on_value_change(lambda event: self._move(each.key, float(event.value)))
            self._bars[each.key] = bar

    def _move(self, key: str, at: float) -> None:
        self.positions[key] = round(at, 6)
        self._tell()
        self._on_move()

    def _reset(self) -> None:
        for each in self._sliders:
            self._bars[each.key].value = prices.position(each, self._own)

    def _tell(self) -> None:
        for each in self._sliders:
            fill(self._values[each.key], prices.value_text(each, self.positions[each.key], self._own))
        is_moved = bool(prices.changes(self.positions, self._own)) and self._where
        told = prices.command(self._where, self.positions, self._own) if is_moved else ""
        fill(self._command, f"<code>{html.escape(told)}</code>" if told else "")
