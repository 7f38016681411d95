"""TOML and JSON of others are read or refused, whatever is in them."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm.common.scenario.documents import MOST_LEVELS, parse_json, parse_toml

NESTED = "[" * 20_000 + "]" * 20_000


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (f"a = {NESTED}", "nested too deeply"),
        ("a = " + "9" * 10_000, "a number of too many digits"),
        (".".join("a" * 40_000) + " = 1", f"a key of more than {MOST_LEVELS} levels"),
        ("[" + " . ".join(["'a'"] * 40_000) + "]", f"a key of more than {MOST_LEVELS} levels"),
    ],
    ids=["nested", "digits", "key", "table"],
)
def test_toml_that_nobody_means_is_refused(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        parse_toml(text)


def test_a_byte_order_mark_is_no_matter() -> None:
    assert parse_toml("\ufeffname = 'a'\n") == {"name": "a"}


def test_a_map_is_no_key() -> None:
    drawn = "\n".join(". * E X # " * 40 for _ in range(40))
    assert parse_toml(f'map = """\n{drawn}"""') == {"map": drawn}


@pytest.mark.parametrize(("text", "says"), [(NESTED, "too deeply"), ("9" * 10_000, "too many digits"), ("{", "line 1")])
def test_json_that_nobody_means_is_refused(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        parse_json(text)


@given(st.text(alphabet="ab.=[]{}\"'\n 1,#_", max_size=60))
def test_any_text_is_what_it_is_to_tomllib_or_refused(text: str) -> None:
    try:
        expected = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        with pytest.raises(tomllib.TOMLDecodeError):
            parse_toml(text)
    else:
        assert parse_toml(text) == expected
