"""`jouleswarm bill` and `jouleswarm validate` as typed, and the calculator from Python."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pandas as pd
import pytest

from jouleswarm import Meter, bill
from jouleswarm.cli import main as cli
from jouleswarm.common.errors import ConfigurationError

TABLE = Path(__file__).parents[2] / "examples" / "paper_table_ii.csv"


def called(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["jouleswarm", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


def test_table_ii_in_fig_4_out(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert called(monkeypatch, "bill", str(TABLE), "--json", "--figures", str(tmp_path)) == 0
    arms = json.loads(capsys.readouterr().out)["arms"]
    assert arms["MAML t0=42"]["energy_j"]["published"]["total"] == pytest.approx(106_301.25)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fig4a.png", "fig4a.svg", "fig4b.png", "fig4b.svg"]


def test_files_and_folders_are_one_experiment(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for number in (1, 2):
        meter = Meter(f"client-{number}", file=tmp_path / f"{number}.csv")
        with meter.phase("train"):
            meter.gradients(50)
        meter.close()
    files = sorted(map(str, tmp_path.glob("*.csv")))
    for given in ([str(tmp_path)], files):
        assert called(monkeypatch, "bill", *given) == 0
        out = capsys.readouterr().out
        assert "204 J" in out  # 2 x 50 x 2.04 J
        assert "Measured beside it, in no bill" in out
        assert "experiment, robots: train" in out


def test_what_can_not_be_is_one_line_and_exit_code_2(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "c.csv").write_text("what,value\nrounds,inf\n")
    assert called(monkeypatch, "bill", str(tmp_path / "c.csv")) == 2
    assert "c.csv, line 2: value: Input should be a finite number" in capsys.readouterr().err
    (tmp_path / "c.csv").write_text("what,value\nrounds,3\nbatches,2\n")
    assert called(monkeypatch, "bill", str(tmp_path / "c.csv"), "--figures", str(tmp_path / "f")) == 2
    out, err = capsys.readouterr()
    assert "Literal prices: by cause" in out
    assert "the arms have t0 0, expected one without and others" in err
    assert called(monkeypatch, "bill") == 2


def test_constants_that_are_ranges_give_intervals(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "c.csv").write_text("arm,what,value\n,batches,1\na,rounds,100\nb,rounds,50\n")
    assert called(monkeypatch, "bill", str(tmp_path / "c.csv"), "--set", "energy.pk_w={low=1, high=3}") == 0
    out = capsys.readouterr().out
    assert "E where constants are ranges: pk_w 1 to 3" in out
    assert " to 118 J" in out  # the middle 95% of 1 to 3 W ends at 2.95 W, of 0.4 s and 100 gradients
    assert "100.0%" in out


def test_the_calculator_from_python(tmp_path: Path) -> None:
    found = bill(rounds={1: 10, 2: 5}, robots=2, links=2, batches=20, model_bytes=5.6e6)
    assert isinstance(found, pd.DataFrame)
    assert found.loc["experiment", ("fl", "computing_robots")] == pytest.approx(15 * 81.6)
    assert found.to_numpy().sum() == pytest.approx(15 * 260.8)
    assert bill(TABLE, prices="published").loc["no MAML"].sum() == pytest.approx(226_965.45)
    dearer = bill(TABLE, set={"energy.pk_w": 10.2}).loc["no MAML", ("fl", "computing_robots")]
    assert dearer == pytest.approx(2 * 921.5 * 81.6)
    with pytest.raises(ConfigurationError, match="expected counts, or what was done by name, and not both"):
        bill()


def test_validate_says_what_a_run_will_cost(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "dear.toml").write_text("[energy]\npk_w = 1000.0\n")
    typed = ("run", "--dry", "toy", "--rounds", "3", "--energy", str(tmp_path / "dear.toml"))
    assert called(monkeypatch, *typed, "--out", str(tmp_path / "runs")) == 0
    out = capsys.readouterr().out
    assert "A round of all clusters together, literal prices" in out
    assert "16 kJ" in out  # 4 robots of 10 batches, of 1000 W x 0.4 s
    assert "Time, estimate: " in out
    assert "and each task takes 3 rounds" in out
    assert not (tmp_path / "runs").exists()
    assert called(monkeypatch, "validate", "no-such") == 2
    assert called(monkeypatch, "run", "--dry") == 2
