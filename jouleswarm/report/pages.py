"""Pages from templates: each one file with its style and its script in it, and nothing from elsewhere."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from jouleswarm.report.table import styled

_FOLDER = "templates"


def rendered(template: str, script: str = "", **values: Any) -> str:
    """A page; `script` names one of ours, and the browser is told to run no other."""
    text = _text(script) if script else ""
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    ours = {"style": Markup(_text("report.css")), "script": Markup(text), "digest": digest}
    return _templates().get_template(template).render(**values, **ours)


def part(name: str, told: Any) -> str:
    """`answer` of what is said, or `table` of a table, as a piece of a page."""
    return str(getattr(_templates().get_template("parts.html.j2").module, name)(told))


@cache
def _templates() -> Environment:
    """All that comes from a run is escaped: names and labels are whatever somebody has written."""
    made = Environment(
        loader=PackageLoader("jouleswarm.report", _FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.globals["styled"] = styled
    return made


def _text(name: str) -> str:
    return (files("jouleswarm.report") / _FOLDER / name).read_text(encoding="utf-8")
