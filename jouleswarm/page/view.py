"""The page in the browser: elements of NiceGUI, filled from the model. One object a browser that has it open."""

from __future__ import annotations

from nicegui import ui

from jouleswarm.page import prices
from jouleswarm.page.charts import causes_chart, growth_chart, rewards_chart
from jouleswarm.page.drawing import svg
from jouleswarm.page.elements import box, card, fill, redraw, text
from jouleswarm.page.maps import Walk, has_maps, map_svg
from jouleswarm.page.model import ArmPriced, Shown, priced
from jouleswarm.page.sliders import Sliders
from jouleswarm.page.style import CSS
from jouleswarm.page.watch import Watch
from jouleswarm.page.words import answer_section, arm_cards, events_list, heading

_EVERY_S = 0.25


class View:
    """Built empty; what is known fills it."""

    def __init__(self, watch: Watch[Shown]) -> None:
        self._watch = watch
        self._shown: Shown | None = None
        ui.add_css(CSS)
        ui.colors(primary="#b06f00")
        with ui.element("main"):
            self._heading = text(heading(watch.title, None))
            self._trouble = text("")
            self._answer = text("")
            self._arms = text("")
            self._body = ui.element("div")
        ui.timer(_EVERY_S, self.update)

    def update(self) -> None:
        """Show what has come since."""
        shown = self._watch.shown
        fill(self._trouble, self._watch.trouble)
        if shown is None or shown is self._shown:
            return
        if self._shown is None:
            self._build(shown)
        self._shown = shown
        fill(self._heading, heading(self._watch.title, shown))
        fill(self._drawing, svg(shown.scenario, shown.moved))
        fill(self._events, events_list(shown.events))
        self._draw_tasks(shown)
        self._price()

    def _build(self, shown: Shown) -> None:
        with self._body:
            with box("columns"):
                with card("What went over the links"):
                    self._drawing = text("")
                with card("Joules by cause"):
                    self._causes = ui.echart(causes_chart(())).style("height: 25rem; width: 100%")
            self._sliders = Sliders(prices.SLIDERS, shown.scenario.energy, self._watch.where, self._price)
            with box("columns wide"):
                with card("Joules against rounds"):
                    self._growth = ui.echart(growth_chart(())).style("height: 17rem; width: 100%")
                with card("What happened"):
                    self._events = text("")
            with box("tasks wide"):
                self._tasks = {task: self._build_task(shown, task) for task in shown.scenario.clusters}

    def _build_task(self, shown: Shown, task: int) -> tuple[ui.echart, ui.html | None]:
        scenario = shown.scenario
        chart = rewards_chart((), task, {}, {}, scenario.federation.target_reward)
        with card(f"Task {task}: reward and path" if has_maps(scenario) else f"Task {task}: reward"):
            drawn = ui.echart(chart).style("height: 13rem; width: 100%")
            return drawn, text("") if has_maps(scenario) else None

    def _draw_tasks(self, shown: Shown) -> None:
        labels = {arm.name: arm.label for arm in shown.arms}
        colours = {arm.name: arm.colour for arm in shown.arms}
        for task, (chart, map_) in self._tasks.items():
            target = shown.scenario.federation.target_reward
            redraw(chart, rewards_chart(shown.curves, task, labels, colours, target))
            if map_ is not None:
                found = ((arm, shown.paths.get((arm.name, task))) for arm in shown.arms)
                walks = [Walk(arm.label, arm.colour, cells, task not in arm.over) for arm, cells in found if cells]
                fill(map_, map_svg(shown.scenario, task, walks))

    def _price(self) -> None:
        """Everything that depends on a price; what was done is at hand."""
        shown = self._shown
        if shown is None:
            return
        energy = prices.repriced(shown.scenario, self._sliders.positions)
        arms: list[ArmPriced] = [priced(arm, shown.prices, energy) for arm in shown.arms]
        fill(self._answer, answer_section(shown, energy))
        fill(self._arms, arm_cards(arms, shown.is_over))
        redraw(self._causes, causes_chart(arms))
        redraw(self._growth, growth_chart(arms))
