"""`jouleswarm study ...`: what is said, and with which exit code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from jouleswarm.studies import run

ROOT = Path(__file__).parents[2]
TOY = str(ROOT / "scenarios" / "toy.toml")
Call = Callable[..., tuple[int, str, str]]


def test_studies_stand_beside_the_commands_of_the_fleet(jouleswarm: Call) -> None:
    code, out, _ = jouleswarm("--help")
    assert code == 0
    assert all(name in out for name in ("run", "record", "report", "audit", "study"))


def test_every_study_has_the_same_options(jouleswarm: Call) -> None:
    for name in ("paper", "baselines", "sensitivity", "regimes", "similarity", "codecs", "experience"):
        code, out, _ = jouleswarm("study", name, "--help")
        assert code == 0
        assert all(option in out for option in ("--seeds", "--scheduler", "--workers", "--results", "--keep"))


def test_tables_are_made_again_without_a_run(jouleswarm: Call, paper_results: Path) -> None:
    code, out, _ = jouleswarm("study", "tables", str(paper_results), "--figures", "")
    assert code == 0
    assert str(paper_results / "table2.md") in out.splitlines()


def test_tables_at_other_prices_go_to_another_folder(jouleswarm: Call, paper_results: Path, tmp_path: Path) -> None:
    arguments = ("study", "tables", str(paper_results), "--figures", "", "--set", "energy.robots_g_per_kwh=50")
    code, _, err = jouleswarm(*arguments)
    assert (code, "expected --out FOLDER" in err) == (2, True)
    code, out, _ = jouleswarm(*arguments, "--out", str(tmp_path / "other"))
    assert code == 0
    assert str(tmp_path / "other" / "energy.md") in out.splitlines()


def test_a_folder_without_a_study_is_one_line_and_its_exit_code(jouleswarm: Call, tmp_path: Path) -> None:
    code, _, err = jouleswarm("study", "tables", str(tmp_path))
    assert code == 2
    assert err.startswith(f"jouleswarm study: {tmp_path / 'study.json'}: cannot be read")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--scenario", "nowhere.toml"), "scenario nowhere.toml: cannot be read"),
        (("--scenario", TOY, "--seeds", "0"), "got 0 seeds from 1 on"),
        (("--scenario", TOY, "--set", "meta.t9=3"), "meta.t9: no such field; did you mean meta.t0?"),
        (("--scenario", TOY, "--set", "energy.idle_w=2"), "energy: got loss, idle power"),
    ],
)
def test_what_cannot_be_planned_is_refused_before_anything_is_written(
    arguments: tuple[str, ...], message: str, jouleswarm: Call, tmp_path: Path
) -> None:
    results, work = tmp_path / "results", tmp_path / "work"
    code, _, err = jouleswarm("study", "paper", *arguments, "--results", str(results), "--work", str(work))
    assert (code, message in err) == (2, True)
    assert not results.exists()
    assert not work.exists()


def test_folders_are_named_after_study_and_profile(
    jouleswarm: Call, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    seen: list[run.Where] = []
    monkeypatch.setattr(run, "run_study", lambda kind, request, profile, where, console: seen.append(where) or [])
    jouleswarm("study", "paper", "--profile", "paper")
    jouleswarm("study", "regimes", "--scenario", TOY)
    assert [where.results for where in seen] == [Path("results/paper"), Path("results/toy-regimes")]
    assert [where.work for where in seen] == [Path("runs/study-paper-paper"), Path("runs/study-regimes-toy")]


def test_the_second_case_is_priced_from_committed_facts(jouleswarm: Call, tmp_path: Path) -> None:
    baselines = str(ROOT / "results" / "compact-baselines")
    code, out, _ = jouleswarm("study", "savazzi2021", baselines, "--results", str(tmp_path / "made"))
    assert (code, str(tmp_path / "made" / "winners.png") in out.splitlines()) == (0, True)
    for wrong, told in (("meta.t0=3", "anything else needs another run"), ("energy.loss=0.1", "facts are sums")):
        code, _, err = jouleswarm("study", "savazzi2021", baselines, "--set", wrong, "--results", str(tmp_path / "not"))
        assert (code, err.count("\n"), told in err) == (2, 1, True)
    assert not (tmp_path / "not").exists()


def test_further_seeds_are_of_the_paper_study_alone(jouleswarm: Call) -> None:
    code, _, told = jouleswarm("study", "regimes", "--more-seeds", "2")
    assert code == 2
    assert "got --more-seeds, which is of `study paper` alone" in told
