"""A meter's page in the browser: elements of NiceGUI, filled from the model. One object a browser that has it open."""

from __future__ import annotations

from nicegui import ui

from jouleswarm.page.elements import box, card, fill, redraw, text
from jouleswarm.page.meter.charts import clients_chart, links_chart, time_chart
from jouleswarm.page.meter.drawing import meter_svg
from jouleswarm.page.meter.model import MeterShown, meter_priced
from jouleswarm.page.meter.words import busiest_table, meter_heading, notes_text, total_section
from jouleswarm.page.sliders import Sliders
from jouleswarm.page.style import CSS
from jouleswarm.page.watch import Watch

_EVERY_S = 0.25


class MeterView:
    """Built empty; what is known fills it."""

    def __init__(self, watch: Watch[MeterShown]) -> None:
        self._watch = watch
        self._shown: MeterShown | None = None
        ui.add_css(CSS)
        ui.colors(primary="#b06f00")
        with ui.element("main"):
            self._heading = text(meter_heading(watch.title, None))
            self._trouble = text("")
            self._total = text("")
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
        fill(self._heading, meter_heading(self._watch.title, shown))
        fill(self._drawing, meter_svg(shown))
        fill(self._notes, notes_text(shown.notes))
        self._price()

    def _build(self, shown: MeterShown) -> None:
        with self._body:
            with box("columns"):
                with card(f"What went between clients and the {shown.hub}"):
                    self._drawing = text("")
                with card("Joules of messages, by client"):
                    self._clients = ui.echart({}).style("height: 25rem; width: 100%")
            self._sliders = Sliders(shown.sliders, shown.tariff.energy, self._watch.where, self._price)
            with box("columns wide"):
                with card("Joules by link"):
                    self._links = ui.echart({}).style("height: 15rem; width: 100%")
                if shown.tells_time:
                    with card("By time"):
                        self._time = ui.echart({}).style("height: 15rem; width: 100%")
            with card("Who moves most", "wide"):
                self._busiest = text("")
                self._notes = text("")

    def _price(self) -> None:
        """Everything that depends on a price; what passed is at hand."""
        shown = self._shown
        if shown is None:
            return
        priced = meter_priced(shown, self._sliders.positions)
        fill(self._total, total_section(shown, priced))
        redraw(self._clients, clients_chart(shown, priced))
        redraw(self._links, links_chart(shown, priced))
        if shown.tells_time:
            redraw(self._time, time_chart(shown, priced))
        fill(self._busiest, busiest_table(priced.busiest))
