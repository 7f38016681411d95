"""TOML and JSON that somebody else wrote: whatever they hold, they are read or refused with one clear line."""

from __future__ import annotations

import json
import re
import tomllib
from typing import Any

MOST_LEVELS = 32
# Possessive, and from the beginning of a name only: in time that grows with the text, and no faster.
_NAME = r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_DEEP_KEY = re.compile(rf"(?:{_NAME}[ \t]*+\.[ \t]*+){{{MOST_LEVELS}}}")
_TOO_DEEP = "nested too deeply"
_TOO_LONG = "a number of too many digits"


def parse_toml(text: str) -> dict[str, Any]:
    """A TOML document; a byte-order mark at its beginning is no matter.

    Raises:
        ValueError: it is none (then a `TOMLDecodeError`), or nothing that anybody means.
    """
    if _DEEP_KEY.search(text):  # each level costs the parser all levels before it
        raise ValueError(f"a key of more than {MOST_LEVELS} levels")
    try:
        return tomllib.loads(text.removeprefix("\ufeff"))
    except tomllib.TOMLDecodeError:
        raise
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    except ValueError:
        raise ValueError(_TOO_LONG) from None


def parse_json(text: str | bytes) -> Any:
    """A JSON document.

    Raises:
        ValueError: it is none, or nothing that anybody means.
    """
    try:
        return json.loads(text)
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    except ValueError:
        raise ValueError(_TOO_LONG) from None
