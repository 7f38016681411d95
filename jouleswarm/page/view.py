"""The page in the browser: elements of NiceGUI, filled from the model. One object a browser that has it open."""

from __future__ import annotations

import html

from nicegui import ui

from jouleswarm.page import prices
from jouleswarm.page.charts import causes_chart, growth_chart, rewards_chart
from jouleswarm.page.drawing import svg
from jouleswarm.page.maps import Walk, has_maps, map_svg
from jouleswarm.page.model import ArmPriced, Shown, priced
from jouleswarm.page.style import CSS
from jouleswarm.page.watch import Watch
from jouleswarm.page.words import answer_section, arm_cards, events_list, heading

_EVERY_S = 0.25


class _Slider(ui.slider):
    LOOPBACK = False  # its position is the browser's: an answer that comes late would move it back


class View:
    """Built empty; what is known fills it."""

    def __init__(self, watch: Watch) -> None:
        self._watch = watch
        self._shown: Shown | None = None
        self._positions: dict[str, float] = {}
        ui.add_css(CSS)
        ui.colors(primary="#b06f00")
        with ui.element("main"):
            self._heading = _html(heading(watch.title, None))
            self._trouble = _html("")
            self._answer = _html("")
            self._arms = _html("")
            self._body = ui.element("div")
        ui.timer(_EVERY_S, self.update)

    def update(self) -> None:
        """Show what has come since."""
        shown = self._watch.shown
        _set(self._trouble, self._watch.trouble)
        if shown is None or shown is self._shown:
            return
        if self._shown is None:
            self._build(shown)
        self._shown = shown
        _set(self._heading, heading(self._watch.title, shown))
        _set(self._drawing, svg(shown.scenario, shown.moved))
        _set(self._events, events_list(shown.events))
        self._draw_tasks(shown)
        self._price()

    def _build(self, shown: Shown) -> None:
        self._positions = {each.key: prices.position(each, shown.scenario.energy) for each in prices.SLIDERS}
        with self._body:
            with _box("columns"):
                with _card("What went over the links"):
                    self._drawing = _html("")
                with _card("Joules by cause"):
                    self._causes = ui.echart(causes_chart(())).style("height: 25rem; width: 100%")
            with _card("Other prices: what was done stays, and is priced again at once", "wide"):
                self._build_sliders(shown)
            with _box("columns wide"):
                with _card("Joules against rounds"):
                    self._growth = ui.echart(growth_chart(())).style("height: 17rem; width: 100%")
                with _card("What happened"):
                    self._events = _html("")
            with _box("tasks wide"):
                self._tasks = {task: self._build_task(shown, task) for task in shown.scenario.clusters}

    def _build_sliders(self, shown: Shown) -> None:
        self._values: dict[str, ui.html] = {}
        self._sliders: dict[str, ui.slider] = {}
        with _box("sliders"):
            for each in prices.SLIDERS:
                low, high = prices.BOUNDS if each.is_factor else prices.CARBON_BOUNDS
                step = prices.STEP if each.is_factor else prices.CARBON_STEP
                with _box("slider").props(f'data-key="{each.key}" title="{each.meaning}"'):
                    _html(each.symbol)
                    self._values[each.key] = _html("").classes("value")
                    start = self._positions[each.key]
                    slider = _Slider(min=low, max=high, step=step, value=start).props(f'aria-label="{each.meaning}"')
                    slider.on_value_change(lambda event, key=each.key: self._move(key, float(event.value)))
                    self._sliders[each.key] = slider
        with _box("head"):
            ui.button("the run's own prices", on_click=self._reset).props("flat dense no-caps")
            self._command = _html("")

    def _build_task(self, shown: Shown, task: int) -> tuple[ui.echart, ui.html | None]:
        scenario = shown.scenario
        chart = rewards_chart((), task, {}, {}, scenario.federation.target_reward)
        with _card(f"Task {task}: reward and path" if has_maps(scenario) else f"Task {task}: reward"):
            drawn = ui.echart(chart).style("height: 13rem; width: 100%")
            return drawn, _html("") if has_maps(scenario) else None

    def _draw_tasks(self, shown: Shown) -> None:
        labels = {arm.name: arm.label for arm in shown.arms}
        colours = {arm.name: arm.colour for arm in shown.arms}
        for task, (chart, map_) in self._tasks.items():
            target = shown.scenario.federation.target_reward
            _redraw(chart, rewards_chart(shown.curves, task, labels, colours, target))
            if map_ is not None:
                found = ((arm, shown.paths.get((arm.name, task))) for arm in shown.arms)
                walks = [Walk(arm.label, arm.colour, cells, task not in arm.over) for arm, cells in found if cells]
                _set(map_, map_svg(shown.scenario, task, walks))

    def _price(self) -> None:
        """Everything that depends on a price; what was done is at hand."""
        shown = self._shown
        if shown is None:
            return
        own, energy = shown.scenario.energy, prices.repriced(shown.scenario, self._positions)
        arms: list[ArmPriced] = [priced(arm, shown.prices, energy) for arm in shown.arms]
        _set(self._answer, answer_section(shown, energy))
        _set(self._arms, arm_cards(arms, shown.is_over))
        _redraw(self._causes, causes_chart(arms))
        _redraw(self._growth, growth_chart(arms))
        for each in prices.SLIDERS:
            _set(self._values[each.key], prices.value_text(each, self._positions[each.key], own))
        is_moved = bool(prices.changes(self._positions, own)) and self._watch.where
        told = prices.command(self._watch.where, self._positions, own) if is_moved else ""
        _set(self._command, f"<code>{html.escape(told)}</code>" if told else "")

    def _move(self, key: str, at: float) -> None:
        self._positions[key] = round(at, 6)
        self._price()

    def _reset(self) -> None:
        if self._shown is not None:
            for each in prices.SLIDERS:
                self._sliders[each.key].value = prices.position(each, self._shown.scenario.energy)


def _html(content: str) -> ui.html:
    return ui.html(content, sanitize=False)  # ours, with all that others have named escaped


def _box(classes: str) -> ui.element:
    return ui.element("div").classes(classes)


def _card(title: str, classes: str = "") -> ui.element:
    card = _box(f"card {classes}")
    with card:
        _html(f"<h2>{title}</h2>")
    return card


def _set(element: ui.html, content: str) -> None:
    """Only what differs goes to the browser: a drawn robot would begin its path anew."""
    if element.content != content:
        element.set_content(content)


def _redraw(chart: ui.echart, options: dict[str, object]) -> None:
    if chart.options != options:
        chart.options.clear()
        chart.options.update(options)
        chart.update()
