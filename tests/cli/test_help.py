"""What every command says of itself at 80 columns, and what it loads to say so."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.main

from jouleswarm.cli.help import first_sentence
from jouleswarm.cli.main import app

Call = Callable[..., tuple[int, str, str]]
HEAVY = ("torch", "matplotlib", "pandas", "scipy", "cv2", "gymnasium", "dask", "mlflow", "tensorboard", "pyarrow")


def commands(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    yield path
    for name, command in getattr(group, "commands", {}).items():
        yield from commands(command, (*path, name))


EVERY = list(commands(typer.main.get_command(app)))


@pytest.mark.parametrize("path", EVERY, ids=lambda path: " ".join(path) or "jouleswarm")
def test_a_help_text_is_whole_at_80_columns(
    path: tuple[str, ...], jouleswarm: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = jouleswarm(*path, "--help")
    assert code == 0
    assert [line for line in out.splitlines() if len(line) > 80 or "…" in line] == []
    about = " ".join(out.split("\n\n")[1].split())
    assert about[0].isupper()
    assert about.endswith((".", "):"))
    _, _, listed = out.partition("\nCommands:\n")
    for name in (each[-1] for each in EVERY if each[:-1] == path and each != path and listed):
        after = " ".join(listed.partition(f"  {name} ")[2].split())
        sentence = first_sentence(after)
        assert sentence.endswith("."), sentence
        _, shown, _ = jouleswarm(*path, name, "--help")
        assert sentence in " ".join(shown.split())


def test_a_sentence_goes_on_after_an_abbreviation() -> None:
    text = "\n    The paper's Table II and its Figs. 3\n    and 4 (cf. Savazzi et al. 2021).  More.\n"
    assert first_sentence(text) == "The paper's Table II and its Figs. 3 and 4 (cf. Savazzi et al. 2021)."


def test_help_and_mistakes_load_nothing_heavy() -> None:
    words = [
        *(["--help"], ["--version"], ["report", "--help"], ["scenarios"], ["run", "nowhere.toml"], ["run", "quik"]),
        *(["validate", "nowhere.toml"], ["report", "nowhere"], ["compare", "nowhere", "nowhere"], ["runs", "nowhere"]),
        *(["export", "nowhere", "--to", "csv"], ["bill", "nowhere.csv"], ["study", "tables", "nowhere"]),
        *(["calibrate", "nowhere.toml", "--role", "robot"], ["meter", "watch", "nowhere"], ["run", "--resume", "no"]),
    ]
    code = f"""
import sys
from jouleswarm.cli.main import main
for words in {words!r}:
    sys.argv = ["jouleswarm", *words]
    try:
        main()
    except SystemExit as end:
        assert (end.code or 0) == (2 if any(word.startswith(("no", "quik")) for word in words) else 0), words
    assert not (loaded := {HEAVY!r} & sys.modules.keys()), (words, loaded)
    assert words != ["--help"] or not {{"numpy", "pydantic", "networkx"}} & sys.modules.keys()
""".replace(repr(HEAVY), repr(set(HEAVY)))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_version_is_told(jouleswarm: Call) -> None:
    assert jouleswarm("--version") == (0, "jouleswarm 0.1.0\n", "")


@pytest.mark.parametrize(
    ("typed", "offered"),
    [("stu", ["study"]), ("run qu", ["quick"]), ("validate m", ["minigrid", "mine.toml"]), ("run fol", ["folder/"])],
)
def test_a_shell_is_given_what_can_follow(
    typed: str, offered: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").touch()
    (tmp_path / "folder").mkdir()
    monkeypatch.setenv("_JOULESWARM_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", f"jouleswarm {typed}")
    monkeypatch.setenv("COMP_CWORD", str(len(typed.split())))
    with pytest.raises(SystemExit):
        app(prog_name="jouleswarm")
    assert capsys.readouterr().out.split() == offered
