"""`jouleswarm calibrate`, and the file that it writes."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from jouleswarm.cli import main as cli
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import energy_file, load_scenario
from jouleswarm.methods.calibration import Calibration
from jouleswarm.report.calibration import calibration_table, energy_lines, write_energy

Call = Callable[..., tuple[int, str, str]]
TINY = ("--set", "network.dense=[4]", "--set", "network.conv=[[2,8,4]]", "--repeats", "3")


@pytest.fixture
def calibrate(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    monkeypatch.setattr("jouleswarm.methods.calibration._WINDOW_S", 0.05)
    monkeypatch.setattr("jouleswarm.common.process.use_one_thread", lambda: None)  # it would stay so for later tests

    def call(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["jouleswarm", "calibrate", *arguments])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, err = capsys.readouterr()
        return (ended.value.code if isinstance(ended.value.code, int) else 0), out, err

    return call


def test_both_roles_write_into_one_file_that_prices_a_scenario(calibrate: Call, tmp_path: Path) -> None:
    file = tmp_path / "energy.toml"
    file.write_text("[energy]\npue = 1.2  # mine\npk_w = 7\n")
    for role in ("robot", "datacenter"):
        code, out, err = calibrate("toy", "--role", role, "--write", str(file), *TINY)
        assert code == 0, err
        assert f"{role} on cpu: toy" in out
    held = tomllib.loads(file.read_text())["energy"]
    assert set(held) == {"pue", "tk_batch_s", "pk_w", "t0_batch_s", "p0_w", "beta"}
    assert "pue = 1.2  # mine" in file.read_text()
    energy = load_scenario("toy", [*energy_file(file), "energy.pue=1.5"]).energy
    assert (energy.pue, energy.tk_batch_s, energy.beta) == (1.5, held["tk_batch_s"], held["beta"])
    assert held["tk_batch_s"] > 0
    assert held["beta"] >= 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--role", "cook"], "--role cook: expected robot or datacenter"),
        (["--role", "robot", "--device", "abacus"], "--device abacus: expected cpu or cuda"),
        (["--role", "robot", "--device", "cuda"], "--device cuda: PyTorch finds no such device here; expected cpu"),
        (["--role", "robot", "--write", "."], "energy file .: cannot be read (Is a directory)"),
        (["--role", "robot", "--write", "no/where.toml"], "--write no/where.toml: there is no folder no"),
        (["--role", "robot", "--write", "other.toml"], 'energy file other.toml: has ["world"], expected tables [ener'),
    ],
    ids=lambda case: " ".join(case) if isinstance(case, list) else "",
)
def test_bad_input_is_one_line_and_nothing_is_written(
    arguments: list[str], said: str, calibrate: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.toml").write_text("[world]\nrows = 3\n")
    code, _, err = calibrate("toy", *arguments, *TINY)
    assert code == 2
    (line,) = err.splitlines()
    assert said in line
    assert {each.name for each in tmp_path.iterdir()} == {"other.toml"}


def test_constants_are_the_median_and_the_power_that_makes_a_batchs_joules_of_it() -> None:
    found = Calibration("robot", 10, (0.2, 0.4, 0.3, 0.5, 0.9), joules=2.0, how="rapl", beta=None)
    assert found.constants == {"tk_batch_s": 0.4, "pk_w": 5.0}  # 0.4 s x 5 W = 2 J
    assert found.quartiles_s == pytest.approx((0.3, 0.5))
    lines = energy_lines(found, "quick", "cpu")
    assert lines["pk_w"].startswith("pk_w = 5  # rapl; quick on ")
    assert [row[0] for row in calibration_table(found, "quick", "cpu").rows] == ["tk_batch_s", "joules a batch", "pk_w"]


def test_a_device_without_a_counter_has_seconds_and_no_watts() -> None:
    found = Calibration("datacenter", 10, (0.2, 0.2, 0.2), joules=None, how="it cannot be read", beta=2.0)
    assert found.constants == {"t0_batch_s": 0.2, "beta": 2.0}
    assert ["p0_w", "-", "it cannot be read", "590 W"] in calibration_table(found, "quick", "cuda").rows


def test_a_file_that_is_not_written_line_by_line_stays(tmp_path: Path) -> None:
    file = tmp_path / "energy.toml"
    file.write_text("energy = { pue = 1.2 }\n")
    with pytest.raises(ConfigurationError, match="expected a line"):
        write_energy(file, {"pk_w": "pk_w = 5"})
    assert file.read_text() == "energy = { pue = 1.2 }\n"


def test_an_energy_file_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("[energy\n")
    with pytest.raises(ConfigurationError, match=r"bad\.toml: not valid TOML"):
        energy_file(tmp_path / "bad.toml")
    (tmp_path / "typo.toml").write_text("[energy]\npk_watts = 3\n")
    with pytest.raises(ConfigurationError, match=r"energy\.pk_watts: no such field; did you mean energy\.pk_w\?"):
        load_scenario("toy", energy_file(tmp_path / "typo.toml"))
    assert energy_file(None) == []
