"""What a name in a scenario opens, and what is said of one that opens nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.common import doors
from jouleswarm.common.doors import digest, file_of, open_door
from jouleswarm.common.errors import ConfigurationError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mine.py").write_text("class Median:\n    name = 'median'\n")
    return tmp_path


def refusal(name: str, folder: Path | None) -> str:
    with pytest.raises(ConfigurationError) as caught:
        open_door("methods", name, folder)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_a_file_beside_the_scenario_is_opened_by_module_and_name(folder: Path) -> None:
    assert open_door("methods", "mine:Median", folder).name == "median"


def test_a_file_is_loaded_once_while_it_is_the_same(folder: Path) -> None:
    first = open_door("methods", "mine:Median", folder)
    assert open_door("methods", "mine:Median", folder) is first
    (folder / "mine.py").write_text("class Median:\n    name = 'other'\n")
    assert open_door("methods", "mine:Median", folder).name == "other"


def test_a_file_comes_before_an_installed_module_of_that_name(folder: Path) -> None:
    (folder / "json.py").write_text("dumps = 'mine'\n")
    assert open_door("methods", "json:dumps", folder) == "mine"
    assert open_door("methods", "json:dumps", None) is __import__("json").dumps


def test_no_file_can_stand_in_for_a_module_that_another_file_imports(folder: Path) -> None:
    (folder / "string.py").write_text("raise SystemError('not this one')\n")
    (folder / "asks.py").write_text("import string\nfound = string.digits\n")
    assert open_door("methods", "asks:found", folder) == "0123456789"


def test_a_plain_word_is_one_that_ships_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(doors.SHIPPED, "methods", {"ours": "json:dumps"})
    assert open_door("methods", "ours", None) is __import__("json").dumps
    assert refusal("our", None) == "method 'our': expected ours or module:name; did you mean ours?"


def test_a_module_that_is_nowhere(folder: Path) -> None:
    assert (
        refusal("nowhere:X", folder) == f"method 'nowhere:X': no nowhere.py in {folder}, and no such module installed"
    )


def test_a_name_that_the_file_does_not_have(folder: Path) -> None:
    assert refusal("mine:Medain", folder) == (
        f"method 'mine:Medain': {folder / 'mine.py'} has no Medain; did you mean Median?"
    )


def test_a_file_that_cannot_be_imported_is_told_with_its_line(folder: Path) -> None:
    (folder / "broken.py").write_text("import json\n\nscale = 1 / 0\n")
    assert refusal("broken:X", folder) == (
        f"method 'broken:X': {folder / 'broken.py'} cannot be imported: ZeroDivisionError: division by zero (line 3)"
    )


@pytest.mark.parametrize("name", ["mine:", "a b:c", ":X", "mine:X()", "../mine:X"])
def test_what_is_no_name(name: str, folder: Path) -> None:
    assert "expected module:name, for example my_module:MyClass" in refusal(name, folder)


def test_the_file_behind_a_name(folder: Path) -> None:
    path = folder / "mine.py"
    assert file_of("mine:Median", folder) == path
    assert file_of("fl", folder) is None
    assert file_of("json:dumps", folder) is None
    path.write_text("")
    assert digest(path) == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"
