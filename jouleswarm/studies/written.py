"""Numbers of results, written into pages by the tables that they stand in.

A page with many has a template of Jinja beside it, `PAGE.md.j2`. A page with few is its own: a marked span keeps the
expression in a comment before what it came to, `<!-- {{ 1 + 1 }} -->2<!-- / -->`. CONTRIBUTING.md says how to name one.
"""

from __future__ import annotations

import math
import re
import traceback
from collections.abc import Iterable, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from statistics import fmean

from jinja2 import Environment, StrictUndefined, Template, TemplateError
from jinja2.exceptions import TemplateSyntaxError

from jouleswarm.common.errors import ConfigurationError, JouleSwarmError, StudyError
from jouleswarm.studies.files import write_atomically
from jouleswarm.studies.lookup import Results, Row

ENDING = ".j2"
_OPEN, _CLOSE = "<!-- {{", "<!-- / -->"
_AT_THE_START = re.compile(r"^[ >*-]*<!-- (?:\{\{|/ -->)", re.M)
_SPAN = re.compile(r"(<!-- (\{\{(?:(?!-->).)*\}\}) -->)((?:(?!<!--).)*)<!-- / -->", re.S)


def pages_in(folder: Path) -> list[Path]:
    """Pages of a checkout that name numbers: at its top and in `docs/`, by a template or by spans.

    Raises:
        ConfigurationError: there is none.
    """
    pages = [*sorted(folder.glob("*.md")), *sorted(folder.glob("docs/*.md"))]
    templates = [each.with_suffix("") for each in [*folder.glob(f"*.md{ENDING}"), *folder.glob(f"docs/*.md{ENDING}")]]
    found = [*templates, *(page for page in pages if page not in templates and _OPEN in page.read_text("utf-8"))]
    if not found:
        raise ConfigurationError(f"{folder.resolve()}: no page with numbers of results; name one, or go to a checkout")
    return sorted(found)


def written(page: Path, results: Results) -> str:
    """What a page is to hold by these results.

    Raises:
        ConfigurationError: the page or a table cannot be read, or an expression is none.
        StudyError: an expression names a line or a column that there is not.
    """
    template = page.with_name(page.name + ENDING)
    source = template if template.exists() else page
    try:
        text = source.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(
            f"{page}: cannot be read ({error.strerror}); name a page, or write {ENDING}"
        ) from error
    known = environment(results)
    if source == template:
        return rendered(known, text, str(template))
    return _filled(known, text, str(page))


def write(pages: Iterable[Path], results: Results) -> list[Path]:
    """Write pages anew; returns those that have changed."""
    texts = {page: written(page, results) for page in pages}
    changed = [page for page, text in texts.items() if not page.exists() or page.read_text("utf-8") != text]
    for page in changed:
        write_atomically(page, texts[page])
    return changed


def check(pages: Iterable[Path], results: Results) -> None:
    """Whether pages hold what the results come to.

    Raises:
        StudyError: one does not; its first line that differs, and what it is to be.
    """
    for page in pages:
        now = written(page, results).splitlines()
        old = page.read_text("utf-8").splitlines() if page.exists() else []
        for number, (got, expected) in enumerate(zip_longest(old, now), start=1):
            if got != expected:
                raise StudyError(
                    f"{page}, line {number}: got {got!r}, the results come to {expected!r}; run `jouleswarm study "
                    "write`"
                )


def environment(results: Results) -> Environment:
    """The names that an expression may use: CONTRIBUTING.md has them all."""
    made = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)
    made.globals |= {"row": results.row, "rows": results.rows, "study": results.study, "note": results.note}
    made.globals |= {"mean": mean, "sums": sums, "ratios": ratios}
    made.filters |= {"fixed": fixed, "pm": pm, "times": times, "percent": percent, "kilo": kilo}
    made.filters |= {"listed": listed, "p": short_p}
    return made


def _filled(known: Environment, text: str, name: str) -> str:
    if text.count(_OPEN) != len(_SPAN.findall(text)):
        told = f"<!-- {{{{ expression }}}} -->2.4x{_CLOSE}"
        raise ConfigurationError(f"{name}: {text.count(_OPEN)} spans begin and not all end; expected {told}")
    if found := _AT_THE_START.search(text):
        line = text[: found.end()].count("\n") + 1
        raise ConfigurationError(
            f"{name}, line {line}: a span begins the line, which Markdown takes for HTML; put a word before it"
        )

    def filled(span: re.Match[str]) -> str:
        return f"{span[1]}{rendered(known, span[2], name, text[: span.start()].count(chr(10)))}{_CLOSE}"

    return _SPAN.sub(filled, text)


def rendered(known: Environment, text: str, name: str, before: int = 0) -> str:
    """`text` with its expressions as what they come to; `before`: lines of the page above it, for errors."""
    try:
        template = Template.from_code(known, known.compile(text, filename=name), known.make_globals(None))
        return template.render()
    except TemplateSyntaxError as error:
        raise ConfigurationError(f"{name}, line {before + error.lineno}: {error.message}") from error
    except (TemplateError, JouleSwarmError, ArithmeticError, TypeError, ValueError) as error:
        lines = [frame.lineno or 0 for frame in traceback.extract_tb(error.__traceback__) if frame.filename == name]
        kind = type(error) if isinstance(error, JouleSwarmError) else StudyError
        raise kind(f"{name}, line {before + (lines[-1] if lines else 1)}: {error}") from error


def mean(rows: Sequence[Row], column: str) -> float:
    """Of a column."""
    return fmean(_number(row[column]) for row in rows)


def sums(rows: Sequence[Row], column: str, by: str) -> dict[object, float]:
    """Sums of a column over the lines that are alike in another: rounds by seed, say."""
    found: dict[object, float] = {}
    for row in rows:
        found[row[by]] = found.get(row[by], 0.0) + _number(row[column])
    return found


def ratios(some: Mapping[object, float], others: Mapping[object, float]) -> list[float]:
    """Of two `sums`, key by key, where both have it."""
    return [value / others[key] for key, value in some.items() if key in others]


def fixed(value: object, digits: int = 0) -> str:
    """`1,189`, `95.3`; `never` where it is infinite."""
    number = _number(value)
    return "never" if math.isinf(number) else f"{number:,.{digits}f}"


def short_p(value: object) -> str:
    """`0.38`, `1.8e-07`: two digits, as a p value is told."""
    return f"{_number(value):.2g}"


def pm(value: object, half: object, digits: int = 0) -> str:
    """`95.3 ± 12.5`; without the interval of one seed."""
    return fixed(value, digits) if half is None else f"{fixed(value, digits)} ± {fixed(half, digits)}"


def times(value: object, digits: int = 1) -> str:
    """`2.4x`."""
    return f"{fixed(value, digits)}x"


def percent(value: object, digits: int = 0) -> str:
    """`58%` of 0.58."""
    return f"{fixed(100 * _number(value), digits)}%"


def kilo(value: object, digits: int = 1) -> str:
    """`278.5` of 278,516: kJ of J."""
    return fixed(_number(value) / 1e3, digits)


def listed(values: Iterable[object], digits: int = 0) -> str:
    """`59, 35.5 and 38`; numbers alone are rounded."""
    *most, last = [each if isinstance(each, str) else fixed(each, digits) for each in values]
    return f"{', '.join(most)} and {last}" if most else last


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise StudyError(f"got {'an empty cell' if value is None else repr(str(value))}, expected a number")
    return float(value)
