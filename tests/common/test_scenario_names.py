"""Scenarios that come with the package go by a plain name; a file of the user's is taken first."""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario

OWN = """
name = "mine"
methods = ["fl"]
world = { rows = 2, cols = 2 }
tasks = [{ id = 1, map = '''
E .
X .
''' }]
"""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to be in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", ["toy", "quick", "paper", "hexapod", "frozenlake", "cartpole"])
def test_a_scenario_of_the_package_is_read_by_its_name_from_any_folder(name: str) -> None:
    assert load_scenario(name).name == name


@pytest.mark.parametrize("name", ["toy", "mine"])
def test_a_file_without_a_suffix_comes_before_a_name(name: str, elsewhere: Path) -> None:
    (elsewhere / name).write_text(OWN)
    assert load_scenario(name).name == "mine"


def test_a_folder_that_has_the_name_stands_in_nobodys_way(elsewhere: Path) -> None:
    (elsewhere / "toy").mkdir()
    assert load_scenario("toy").name == "toy"


def test_an_unknown_name_is_told_the_known_ones() -> None:
    with pytest.raises(ConfigurationError) as error:
        load_scenario("tyo")
    names = "cartpole, frozenlake, hexapod, minigrid, paper, quick, toy; did you mean toy?"
    assert str(error.value) == f"scenario tyo: no file here, expected one or a name: {names}"


@pytest.mark.parametrize("path", ["quick.toml", "folder/quick"])
def test_what_has_a_suffix_or_a_folder_is_a_file(path: str) -> None:
    with pytest.raises(ConfigurationError, match="cannot be read"):
        load_scenario(path)
