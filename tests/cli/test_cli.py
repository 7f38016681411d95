"""The command line: what is said, and with which exit code."""

import json
import resource
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.fleet.deploy import have_open_files
from jouleswarm.runs.summary import summarise

ROOT = Path(__file__).parents[2]
TOY = ROOT / "scenarios" / "toy.toml"
Call = Callable[..., tuple[int, str, str]]


def toy_with(folder: Path, old: str, new: str) -> Path:
    text = TOY.read_text()
    assert old in text
    path = folder / "changed.toml"
    path.write_text(text.replace(old, new, 1))
    return path


REFUSED: dict[str, tuple[Callable[[Path], list[str]], str]] = {
    "no such file": (lambda _: ["nowhere.toml"], "scenario nowhere.toml: cannot be read (No such file or directory)"),
    "a folder": (lambda folder: [str(folder)], "cannot be read (Is a directory)"),
    "not TOML": (lambda folder: [str(toy_with(folder, "[world]", "[world"))], "not valid TOML"),
    "unknown key": (lambda folder: [str(toy_with(folder, "rows = 4", "lines = 4"))], "world.lines: no such field"),
    "unknown section": (lambda folder: [str(toy_with(folder, "[world]", "[universe]"))], "universe"),
    "value out of range": (lambda folder: [str(toy_with(folder, "rows = 4", "rows = 0"))], "world.rows"),
    "map too small": (lambda folder: [str(toy_with(folder, ". * .\n. X .", ". X ."))], "map has 3 rows, expected 4"),
    "map without exit": (lambda folder: [str(toy_with(folder, ". X .", ". . ."))], "0 exit landmarks"),
    "map with a gap": (lambda folder: [str(toy_with(folder, ". * .", ". . ."))], "task 1: map path: from row 1"),
    "override without =": (lambda _: [str(TOY), "--set", "meta.t0"], "override 'meta.t0': expected section.key=value"),
    "override of nothing": (
        lambda _: [str(TOY), "--set", "meta.t9=3"],
        "meta.t9: no such field; did you mean meta.t0?",
    ),
    "override of the wrong type": (lambda _: [str(TOY), "--set", "meta.t0=soon"], "meta.t0: Input should be a valid"),
    "negative seed": (lambda _: [str(TOY), "--seed", "-1"], "seed: Input should be greater than or equal to 0"),
    "broker URL": (
        lambda _: [str(TOY), "--broker", "http://localhost"],
        "broker URL 'http://localhost': expected mqtt://",
    ),
    "broker port": (lambda _: [str(TOY), "--broker", "mqtt://localhost:99999"], "Port out of range"),
    "run name with a /": (lambda _: [str(TOY), "--run-id", "a/b"], "run name 'a/b': expected letters"),
    "run name with a +": (lambda _: [str(TOY), "--run-id", "a+b"], "run name 'a+b': expected letters"),
    "run name with a #": (lambda _: [str(TOY), "--run-id", "#"], "run name '#': expected letters"),
    "run name of 300 letters": (lambda _: [str(TOY), "--run-id", "x" * 300], "of 300 letters': expected"),
    "run name with a lone surrogate": (lambda _: [str(TOY), "--run-id", "a\udcff"], r"run name 'a\udcff': expected"),
    "override nested deeply": (lambda _: [str(TOY), "--set", "seed=" + "[" * 20_000], "nested too deeply"),
    "override of many levels": (lambda _: [str(TOY), "--set", "a." * 40_000 + "a=1"], "a: no such field"),
    "a number of many digits": (lambda folder: [str(toy_with(folder, "seed = 1", "seed = " + "9" * 9_999))], "digits"),
    "--out below a file": (lambda folder: [str(TOY), "--out", str(toy_with(folder, "seed", "seed") / "x")], "--out "),
    "run name that climbs": (lambda _: [str(TOY), "--run-id", ".."], "run name '..': expected letters"),
}


@pytest.mark.parametrize("case", REFUSED)
@pytest.mark.parametrize("command", ["run", "record"])
def test_what_cannot_be_used_is_said_in_one_line_and_nothing_is_written(
    case: str, command: str, jouleswarm: Call, tmp_path: Path
) -> None:
    arguments, said = REFUSED[case]
    out = tmp_path / "out" / "runs"
    broker = ["--broker", "mqtt://127.0.0.1:1"] if command == "record" and "broker" not in case else []
    code, _, err = jouleswarm(command, "--out", str(out), *arguments(tmp_path), *broker)
    assert code == 2, err
    (line,) = err.splitlines()
    assert line.startswith(f"jouleswarm {command}: ")
    assert said in line
    assert not out.parent.exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["walk"], ["run"], ["run", str(TOY), "--speed", "9"], ["run", str(TOY), "--seed", "one"], ["record", str(TOY)],
        ["run", str(TOY), "--restarts", "-1"], ["run", str(TOY), "--resume", "r"],
        ["run", "--resume", "r", "--seed", "1"],
        ["chaos"], ["chaos", str(TOY), "--faults", "0"], ["chaos", str(TOY), "--kind", "rain"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_wrong_options_have_exit_code_2(
    arguments: list[str], jouleswarm: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("JOULESWARM_BROKER", raising=False)
    code, _, err = jouleswarm(*arguments)
    assert code == 2
    assert "Error: " in err


@pytest.mark.parametrize("command", ["run", "record", "report", "calibrate", "chaos", "audit"])
def test_every_command_explains_itself(command: str, jouleswarm: Call) -> None:
    code, out, _ = jouleswarm(command, "--help")
    assert code == 0
    assert f"Usage: jouleswarm {command}" in out


def test_a_password_in_a_url_is_not_repeated(jouleswarm: Call, tmp_path: Path) -> None:
    _, _, err = jouleswarm("run", str(TOY), "--broker", "amqp://me:secret@host", "--out", str(tmp_path / "out"))
    assert "secret" not in err


def test_a_run_that_is_complete_is_not_gone_on_with(jouleswarm: Call, write_run: Callable[..., Path]) -> None:
    path = write_run()
    before = {each: each.read_bytes() for each in path.rglob("*") if each.is_file()}
    code, _, err = jouleswarm("run", "--resume", str(path))
    assert code == 2
    (line,) = err.splitlines()
    assert "has no state/: it is complete, or was only recorded; see its report" in line
    assert {each: each.read_bytes() for each in path.rglob("*") if each.is_file()} == before


def test_what_is_no_run_is_not_gone_on_with(jouleswarm: Call, tmp_path: Path) -> None:
    code, _, err = jouleswarm("run", "--resume", str(tmp_path))
    assert code == 2
    (line,) = err.splitlines()
    assert "has no manifest.json; name one that `jouleswarm run` printed" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "code", "told"),
    [
        ({"schema": 3}, 5, "run directory of schema 3, this version reads 2"),
        ({"versions": {"jouleswarm": "0.9.0"}}, 5, "written by version 0.9.0 of JouleSwarm, this is 0.1.0; go on with"),
        ({"run": None}, 5, "damaged, it has no 'run'"),
        ({"run": [1]}, 5, "damaged, it has no 'run'"),
    ],
)
def test_a_run_of_another_version_is_not_gone_on_with(
    change: dict[str, Any], code: int, told: str, jouleswarm: Call, write_run: Callable[..., Path]
) -> None:
    path = write_run()
    (path / "state").mkdir()
    manifest = json.loads((path / "manifest.json").read_text()) | change
    (path / "manifest.json").write_text(json.dumps(manifest))
    before = {each: each.read_bytes() for each in path.rglob("*") if each.is_file()}
    found, _, err = jouleswarm("run", "--resume", str(path))
    (line,) = err.splitlines()
    assert (found, told in line) == (code, True), line
    assert {each: each.read_bytes() for each in path.rglob("*") if each.is_file()} == before


def test_a_run_for_which_there_are_too_few_files_is_refused(
    jouleswarm: Call, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (16, 16))
    code, _, err = jouleswarm("run", str(TOY), "--out", str(tmp_path / "out"))
    assert code == 2
    # 16 of its own, 4 robots, the data center, the recorder.
    assert "open files: a process may have 16, expected 22 or more" in err
    assert not (tmp_path / "out").exists()


def test_as_many_open_files_as_a_run_needs_are_had_where_they_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    raised: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "setrlimit", lambda _, limits: raised.append(limits))
    for limits in ((20, 1000), (22, 1000), (20, resource.RLIM_INFINITY)):
        monkeypatch.setattr(resource, "getrlimit", lambda _, limits=limits: limits)
        have_open_files(6)
    assert raised == [(22, 1000), (22, resource.RLIM_INFINITY)]  # 16 and one a client; the second had enough


def test_a_report_of_what_is_not_there_is_refused(jouleswarm: Call, tmp_path: Path) -> None:
    code, _, err = jouleswarm("report", str(tmp_path / "nowhere"))
    assert code == 2
    (line,) = err.splitlines()
    assert "nowhere" in line


def test_a_report_of_what_is_not_a_run_is_refused(jouleswarm: Call, tmp_path: Path) -> None:
    code, _, err = jouleswarm("report", str(tmp_path))
    assert code == 2
    (line,) = err.splitlines()
    assert "manifest.json" in line


@pytest.mark.parametrize(
    "price", [["--ul", "0"], ["--sl", "-3"], ["--pue", "0.5"], ["--beta", "nan"], ["--beta", "much"]], ids=" ".join
)
def test_a_price_that_is_none_is_refused(price: list[str], jouleswarm: Call, write_run: Callable[..., Path]) -> None:
    code, _, err = jouleswarm("report", str(write_run()), *price)
    assert code == 2
    (line,) = err.splitlines()
    assert f"jouleswarm report: {price[0]} {price[1]}: expected a number" in line


def test_a_run_is_priced_again(jouleswarm: Call, write_run: Callable[..., Path]) -> None:
    path = write_run()
    before = {each: each.read_bytes() for each in path.rglob("*") if each.is_file()}
    code, out, _ = jouleswarm("report", str(path), "--ul", "500", "--sl", "200", "--details")
    assert code == 0
    assert "Energy: MAML, t0 = 3" in out
    assert {each: each.read_bytes() for each in path.rglob("*") if each.is_file()} == before


def test_a_run_is_told_in_grams_of_carbon(jouleswarm: Call, write_run: Callable[..., Path], facts: Any) -> None:
    path = write_run(summarise(facts.scenario, facts.rows, facts.meter_rows))
    code, out, _ = jouleswarm("report", str(path), "--carbon-datacenter", "350", "--beta", "1.5", "--details")
    assert code == 0
    assert "gCO2e/kWh: data center 350, robots unknown" in " ".join(out.split())
    assert "beta 1.5" in " ".join(out.split())


def test_a_run_is_held_against_a_meter(jouleswarm: Call, write_run: Callable[..., Path], tmp_path: Path) -> None:
    path, log = write_run(), tmp_path / "power.csv"
    log.write_text("time,watt,name\n5000,15.0,shelly1\n5020,15.0,shelly1\n")
    options = ["--meter", str(log), "--meter-name", "shelly1=agent-1", "--meter-shift", "-4000"]
    code, _, err = jouleswarm("report", str(path), *options)
    assert code == 2
    assert err.endswith(f"{path} has no times (times.jsonl): run its scenario again, with the meter\n")
    time = {"time_s": 1010, "phase": "fl", "arm": "fl", "task": 1, "agent": 1, "round": 1}
    (path / "times.jsonl").write_text(json.dumps(time) + "\n")
    code, out, _ = jouleswarm("report", str(path), *options)
    assert code == 0
    assert " 30 J " in out  # one round of ten has a time; 15 W for its 2 s


def test_the_audit_prints_the_papers_figures(jouleswarm: Call) -> None:
    code, out, _ = jouleswarm("audit")
    assert code == 0
    assert "921.5" in out
