"""Options of the page's charts (Apache ECharts). Pure: data in, plain dictionaries out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from jouleswarm.page.model import ArmPriced, Curve
from jouleswarm.report.format import joules_text

INK = "#777781"
"""Of text and axes: readable on light and on dark ground."""
THIN = {"lineStyle": {"color": INK, "opacity": 0.3}, "onZero": False}
TEXT = {"color": INK, "fontSize": 12}
_KILO_FROM_J = 10_000
_FEW_ROBOTS = 24
"""Robots' own curves are drawn up to here."""

Options = dict[str, Any]


def causes_chart(arms: Sequence[ArmPriced]) -> Options:
    """Joules by cause, arm beside arm; a bar says what it comes to."""
    causes = list(dict.fromkeys(cause for arm in arms for cause in arm.causes))
    series = [
        {
            "type": "bar",
            "name": arm.done.label,
            "color": arm.done.colour,
            "barGap": "15%",
            "data": [_bar(arm.causes.get(cause)) for cause in causes],
        }
        for arm in arms
    ]
    return {
        **base(),
        "grid": {"left": 8, "right": 64, "top": 8, "bottom": 8, "containLabel": True},
        "xAxis": {"type": "value", "axisLabel": {"show": False}, "splitLine": THIN},
        "yAxis": {"type": "category", "data": causes, "inverse": True, "axisLabel": TEXT, "axisLine": THIN},
        "series": series,
    }


def growth_chart(arms: Sequence[ArmPriced]) -> Options:
    """Joules in total against rounds."""
    unit, factor = ("kJ", 1e3) if max((arm.total_j or 0.0 for arm in arms), default=0.0) >= _KILO_FROM_J else ("J", 1.0)
    series = [
        {
            "type": "line",
            "name": arm.done.label,
            "color": arm.done.colour,
            "showSymbol": len(arm.growth) == 1,
            "data": [[round_, joules / factor] for round_, joules in arm.growth],
        }
        for arm in arms
    ]
    return {**_plane("rounds", unit), "series": series}


def rewards_chart(
    curves: Sequence[Curve], task: int, labels: Mapping[str, str], colours: Mapping[str, str], target: float
) -> Options:
    """R of a task's cluster by round, thin lines its robots, and the target."""
    mine = [curve for curve in curves if curve.task == task]
    robots = sum(curve.agent is not None for curve in mine)
    drawn = [curve for curve in mine if curve.agent is None or robots <= _FEW_ROBOTS]
    series: list[Options] = [_curve(curve, labels[curve.arm], colours[curve.arm]) for curve in drawn]
    mark = {"symbol": "none", "silent": True, "data": [{"yAxis": target}], "label": {"show": False}}
    style = {"lineStyle": {"color": INK, "type": "dashed", "width": 1}}
    series.append({"type": "line", "name": "target", "data": [], "color": INK, "markLine": {**mark, **style}})
    return {**_plane("rounds", "R"), "series": series}


def _curve(curve: Curve, label: str, colour: str) -> Options:
    own = curve.agent is not None
    return {
        "type": "line",
        "name": f"{label}, robot {curve.agent}" if own else label,
        "color": colour,
        "showSymbol": len(curve.points) == 1,
        "symbolSize": 4,
        "lineStyle": {"width": 1 if own else 2.5, "opacity": 0.35 if own else 1.0},
        "data": [list(point) for point in curve.points],
    }


def _bar(joules: float | None) -> Options:
    told = {"show": bool(joules), "position": "right", "formatter": joules_text(joules), "color": INK, "fontSize": 11}
    return {"value": joules, "label": told}


def base() -> Options:
    """What all charts have."""
    return {"animationDuration": 300, "animationDurationUpdate": 300, "tooltip": {"confine": True}}


def _plane(across: str, up: str) -> Options:
    name = {"nameTextStyle": TEXT, "axisLabel": TEXT, "axisLine": THIN, "splitLine": THIN, "scale": True}
    return {
        **base(),
        "tooltip": {"trigger": "axis", "confine": True},
        "grid": {"left": 8, "right": 20, "top": 28, "bottom": 22, "containLabel": True},
        "xAxis": {"type": "value", "name": across, "nameLocation": "middle", "nameGap": 24, **name},
        "yAxis": {"type": "value", "name": up, **name},
    }
