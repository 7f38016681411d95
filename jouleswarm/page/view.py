"""A run's page in the browser: elements of NiceGUI, filled from the model."""

from __future__ import annotations

from nicegui import ui

from jouleswarm.page import prices
from jouleswarm.page.charts import causes_chart, growth_chart, rewards_chart
from jouleswarm.page.drawing import svg
from jouleswarm.page.elements import box, card, fill, redraw, text
from jouleswarm.page.frame import Frame
from jouleswarm.page.maps import Walk, has_maps, map_svg
from jouleswarm.page.model import ArmPriced, Shown, priced
from jouleswarm.page.sliders import Sliders
from jouleswarm.page.words import answer_section, arm_cards, events_list, heading
from jouleswarm.report.sliders import SLIDERS


class View(Frame[Shown]):
    """Of a run."""

    def heading(self, shown: Shown | None) -> str:
        return heading(self.watch.title, shown)

    def top(self) -> None:
        self._answer = text("")
        self._arms = text("")

    def build(self, shown: Shown) -> None:
        with box("columns"):
            with card("What went over the links"):
                self._drawing = text("")
            with card("Joules by cause"):
                self._causes = ui.echart(causes_chart(())).style("height: 25rem; width: 100%")
        self._sliders = Sliders(SLIDERS, shown.scenario.energy, self.watch.where, self._price)
        with box("columns wide"):
            with card("Joules against rounds"):
                self._growth = ui.echart(growth_chart(())).style("height: 17rem; width: 100%")
            with card("What happened"):
                self._events = text("")
        with box("tasks wide"):
            self._tasks = {task: self._build_task(shown, task) for task in shown.scenario.clusters}

    def fill(self, shown: Shown) -> None:
        fill(self._drawing, svg(shown.scenario, shown.moved))
        fill(self._events, events_list(shown.events))
        self._draw_tasks(shown)
        self._price()

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
        shown = self.shown
        if shown is None:
            return
        energy = prices.repriced(shown.scenario, self._sliders.positions)
        arms: list[ArmPriced] = [priced(arm, shown.prices, energy) for arm in shown.arms]
        fill(self._answer, answer_section(shown, energy))
        fill(self._arms, arm_cards(arms, shown.is_over))
        redraw(self._causes, causes_chart(arms))
        redraw(self._growth, growth_chart(arms))
