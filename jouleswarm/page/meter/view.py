"""A meter's page in the browser: elements of NiceGUI, filled from the model."""

from __future__ import annotations

from nicegui import ui

from jouleswarm.page.elements import box, card, fill, redraw, text
from jouleswarm.page.frame import Frame
from jouleswarm.page.meter.charts import clients_chart, links_chart, time_chart
from jouleswarm.page.meter.drawing import meter_svg
from jouleswarm.page.meter.model import MeterShown, meter_priced
from jouleswarm.page.meter.words import busiest_table, meter_heading, notes_text, total_section
from jouleswarm.page.sliders import Sliders


class MeterView(Frame[MeterShown]):
    """Of a meter."""

    def heading(self, shown: MeterShown | None) -> str:
        return meter_heading(self.watch.title, shown)

    def top(self) -> None:
        self._total = text("")

    def build(self, shown: MeterShown) -> None:
        with box("columns"):
            with card(f"What went between clients and the {shown.hub}"):
                self._drawing = text("")
            with card("Joules of messages, by client"):
                self._clients = ui.echart({}).style("height: 25rem; width: 100%")
        self._sliders = Sliders(shown.sliders, shown.tariff.energy, self.watch.where, self._price)
        with box("columns wide"):
            with card("Joules by link"):
                self._links = ui.echart({}).style("height: 15rem; width: 100%")
            if shown.tells_time:
                with card("By time"):
                    self._time = ui.echart({}).style("height: 15rem; width: 100%")
        with card("Who moves most", "wide"):
            self._busiest = text("")
            self._notes = text("")

    def fill(self, shown: MeterShown) -> None:
        fill(self._drawing, meter_svg(shown))
        fill(self._notes, notes_text(shown.notes))
        self._price()

    def _price(self) -> None:
        """Everything that depends on a price; what passed is at hand."""
        shown = self.shown
        if shown is None:
            return
        priced = meter_priced(shown, self._sliders.positions)
        fill(self._total, total_section(shown, priced))
        redraw(self._clients, clients_chart(shown, priced))
        redraw(self._links, links_chart(shown, priced))
        if shown.tells_time:
            redraw(self._time, time_chart(shown, priced))
        fill(self._busiest, busiest_table(priced.busiest))
