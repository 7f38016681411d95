"""Options of the charts (Apache ECharts). Pure: data in, plain dictionaries out; names of clients stand in lists only,
which ECharts takes for text."""

from __future__ import annotations

from typing import Any

from jouleswarm.page.charts import INK, TEXT, THIN, base
from jouleswarm.page.meter.drawing import short
from jouleswarm.page.meter.model import LINKS, MeterPriced, MeterShown
from jouleswarm.report.format import bytes_text, joules_text

_COLOURS = {"uplink": "#d55e00", "downlink": "#9a5fb0", "sidelink": "#009e73", "control": "#7f7f8a", "other": "#a8a8b2"}
_COMPUTING, _JOULES = "#0072b2", "#b06f00"

Options = dict[str, Any]


def links_chart(shown: MeterShown, priced: MeterPriced) -> Options:
    """Joules by link, and of what was computed where that is known; a bar says its bytes too."""
    bars = [
        _bar(link, joules, f"{joules_text(joules)}, {bytes_text(shown.links[link].bytes)}", _COLOURS[link])
        for link, joules in priced.links_j.items()
    ]
    bars += [_bar(cause, joules, joules_text(joules), _COMPUTING) for cause, joules in priced.other_causes_j.items()]
    series = {"type": "bar", "name": "joules", "barMaxWidth": 26, "data": bars}
    return {**_lying([bar["name"] for bar in bars], 130), "series": [series]}


def clients_chart(shown: MeterShown, priced: MeterPriced) -> Options:
    """Joules by client, each link a piece of its bar."""
    used = [link for link in LINKS if any(each.get(link) for each in priced.clients_j)]
    series: list[Options] = [
        {
            "type": "bar",
            "name": link,
            "stack": "all",
            "color": _COLOURS[link],
            "barMaxWidth": 20,
            "data": [each.get(link) for each in priced.clients_j],
        }
        for link in used
    ]
    sums = [sum(each or 0.0 for each in links.values()) for links in priced.clients_j]
    told = [_label(0, joules_text(each)) for each in sums]  # a piece of no width, which tells the sum
    series.append({"type": "bar", "name": "all", "stack": "all", "tooltip": {"show": False}, "data": told})
    return {**_lying([short(client.name, 18) for client in shown.clients], 70), "series": series}


def time_chart(shown: MeterShown, priced: MeterPriced) -> Options:
    """Joules and bytes by window of time."""
    at = [1e3 * moment.begin_s for moment in shown.moments]
    moved = [moment.passed.bytes for moment in shown.moments]
    unit, factor = next((each for each in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)) if max(moved, default=0) >= each[1]),
                        ("B", 1.0))  # fmt: skip
    axis = {"nameTextStyle": TEXT, "axisLabel": TEXT, "axisLine": THIN, "splitLine": THIN, "min": 0}
    line = {"type": "line", "showSymbol": len(at) == 1}
    return {
        **base(),
        "tooltip": {"trigger": "axis", "confine": True},
        "legend": {"textStyle": TEXT, "top": 0, "icon": "roundRect", "itemHeight": 3, "data": ["joules", "payload"]},
        "grid": {"left": 8, "right": 8, "top": 46, "bottom": 8, "containLabel": True},
        "xAxis": {"type": "time", "axisLabel": {**TEXT, "hideOverlap": True}, "axisLine": THIN},
        "yAxis": [
            {"type": "value", "name": "J", **axis},
            {"type": "value", "name": unit, **axis, "splitLine": {"show": False}},
        ],
        "series": [
            {**line, "name": "payload", "yAxisIndex": 1, "color": INK, "lineStyle": {"width": 1.5, "type": "dashed"},
             "data": [[ms, count / factor] for ms, count in zip(at, moved, strict=True)]},
            {**line, "name": "joules", "color": _JOULES, "lineStyle": {"width": 2.5},
             "data": [[ms, joules] for ms, joules in zip(at, priced.moments_j, strict=True)]},
        ],
    }  # fmt: skip


def _bar(name: str, joules: float | None, told: str, colour: str) -> Options:
    return {**_label(joules, told), "name": name, "itemStyle": {"color": colour}}


def _label(value: float | None, told: str) -> Options:
    shown = {"show": True, "position": "right", "formatter": told, "color": INK, "fontSize": 11}
    return {"value": value or 0.0, "label": shown}


def _lying(names: list[str], right: int) -> Options:
    return {
        **base(),
        "grid": {"left": 8, "right": right, "top": 8, "bottom": 8, "containLabel": True},
        "xAxis": {"type": "value", "axisLabel": {"show": False}, "splitLine": THIN},
        "yAxis": {"type": "category", "data": names, "inverse": True, "axisLabel": TEXT, "axisLine": THIN},
    }
