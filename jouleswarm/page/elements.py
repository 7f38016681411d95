"""Pieces that pages are built of: elements of NiceGUI."""

from __future__ import annotations

from nicegui import ui


def text(content: str) -> ui.html:
    """HTML of ours, with all that others have named escaped."""
    return ui.html(content, sanitize=False)


def box(classes: str) -> ui.element:
    """A block, laid out by its classes."""
    return ui.element("div").classes(classes)


def card(title: str, classes: str = "") -> ui.element:
    """A framed block under a heading."""
    framed = box(f"card {classes}")
    with framed:
        text(f"<h2>{title}</h2>")
    return framed


def fill(element: ui.html, content: str) -> None:
    """Only what differs goes to the browser: a drawn robot would begin its path anew."""
    if element.content != content:
        element.set_content(content)


def redraw(chart: ui.echart, options: dict[str, object]) -> None:
    """The same for a chart."""
    if chart.options != options:
        chart.options.clear()
        chart.options.update(options)
        chart.update()
