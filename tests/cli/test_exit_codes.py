"""One exit code for one kind of mistake, whichever command it is made with: docs/exit_codes.md."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from jouleswarm.common import errors
from jouleswarm.common.errors import JouleSwarmError

Call = Callable[..., tuple[int, str, str]]
PAGE = Path(__file__).parents[2] / "docs" / "exit_codes.md"

SCENARIO = ["run", "validate", "calibrate --role robot", "chaos", "keys init", "record --broker mqtt://127.0.0.1:1"]
RUN = ["report", "compare", "export --to csv", "run --resume", "meter watch", "study tables", "study savazzi2021"]
OPTION = ["run", "validate", "record", "report", "compare", "export", "runs", "scenarios", "init", "audit", "doctor"]
JSON = ["validate", "report", "compare", "runs"]


def words(text: str, *more: str) -> list[str]:
    return [*text.split(), *more]


@pytest.mark.parametrize("command", SCENARIO)
@pytest.mark.parametrize("scenario", ["nowhere.toml", "quik"])
def test_a_scenario_that_there_is_not_is_2(command: str, scenario: str, jouleswarm: Call, tmp_path: Path) -> None:
    code, _, err = jouleswarm(*words(command, scenario))
    assert (code, len(err.splitlines())) == (2, 1), err


@pytest.mark.parametrize("command", SCENARIO)
def test_a_field_that_there_is_not_is_2_and_the_one_that_was_meant_is_told(command: str, jouleswarm: Call) -> None:
    code, _, err = jouleswarm(*words(command, "toy", "--set", "meta.t9=3"))
    assert (code, "did you mean meta.t0?" in err) == (2, True), err


@pytest.mark.parametrize("command", RUN)
@pytest.mark.parametrize("is_there", [False, True])
def test_what_is_no_run_or_no_results_is_2(command: str, is_there: bool, jouleswarm: Call, tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    if is_there:
        folder.mkdir()
    code, _, err = jouleswarm(*words(command, str(folder)))
    assert (code, len(err.splitlines())) == (2, 1), err


@pytest.mark.parametrize("command", ["report", "compare", "export --to csv", "run --resume"])
@pytest.mark.parametrize("manifest", ["{", '{"schema": 99}'])
def test_a_damaged_run_and_one_of_another_version_are_5(
    command: str, manifest: str, jouleswarm: Call, tmp_path: Path
) -> None:
    (tmp_path / "manifest.json").write_text(manifest)
    code, _, err = jouleswarm(*words(command, str(tmp_path)))
    assert (code, len(err.splitlines())) == (5, 1), err


@pytest.mark.parametrize("command", OPTION)
def test_an_option_that_there_is_not_is_2(command: str, jouleswarm: Call) -> None:
    code, _, err = jouleswarm(command, "--nonsense")
    assert (code, "No such option: --nonsense" in err) == (2, True)


@pytest.mark.parametrize("command", ["doctor"])
def test_a_broker_that_does_not_answer_is_3(command: str, jouleswarm: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("jouleswarm.fleet.doctor._ANSWER_S", 0.2)
    code, _, err = jouleswarm(command, "--broker", "mqtt://127.0.0.1:1")
    assert (code, "no answer within 0.2 s" in err) == (3, True)


@pytest.mark.parametrize("command", JSON)
def test_an_error_is_a_document_where_one_was_asked_for(command: str, jouleswarm: Call) -> None:
    code, out, err = jouleswarm(*words(command, "nowhere", "--json"))
    told = json.loads(out)
    assert (code, err, told.keys()) == (2, "", {"schema", "error"})
    assert (told["error"]["kind"], told["error"]["exit_code"]) == ("configuration", 2)
    assert "nowhere" in told["error"]["message"]
    code, out, err = jouleswarm(*words(command, "nowhere", "--json", "--nonsense"))
    assert (code, err, json.loads(out)["error"]["kind"]) == (2, "", "usage")


def test_the_page_has_every_kind_and_its_code() -> None:
    told = {kind: int(code) for code, kind in re.findall(r"^\| (\d+) \| `(\w+)`", PAGE.read_text(), re.M)}
    kinds = [each for each in vars(errors).values() if isinstance(each, type) and issubclass(each, JouleSwarmError)]
    assert {each.kind: each.exit_code for each in kinds if each.kind != "other"}.items() <= told.items()
