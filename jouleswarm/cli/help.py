"""Help texts: a command's line in its group's list is its first sentence, whole."""

from __future__ import annotations

import inspect
import re

import typer

_END = re.compile(r"(?<!\bFig)(?<!\bFigs)(?<!\beq)(?<!\beqs)(?<!\bcf)(?<!\bal)(?<!\be\.g)(?<!\bi\.e)\.(?=\s|$)")
"""A full stop that ends a sentence, and no abbreviation."""


def first_sentence(text: str | None) -> str:
    """The first sentence of a help text, in one line."""
    paragraph = " ".join(inspect.cleandoc(text or "").split("\n\n")[0].split())
    found = _END.search(paragraph)
    return paragraph if found is None else paragraph[: found.end()]


def tell_whole_sentences(group: typer.Typer) -> None:
    """Typer itself would cut what is long, and after any full stop."""
    for each in group.registered_commands:
        each.short_help = first_sentence(each.help or (each.callback.__doc__ if each.callback else ""))
    for inner in group.registered_groups:
        if inner.typer_instance is not None:
            inner.short_help = first_sentence(inner.typer_instance.info.help)
            tell_whole_sentences(inner.typer_instance)
