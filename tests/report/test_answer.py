"""The answer of the made-up run of tests/made_up_run.py, in numbers and in words.

With task 2 learned by both arms: MAML 3187.92 J, of which 2364.72 J are gradients in the data center, 816 J on robots,
4.8 J uplink, 0.8 J downlink and 1.6 J sidelinks; without transfer 2448 J on robots and 4.8 J sidelinks.
"""

import dataclasses
import io
import json
import sys
from pathlib import Path

import pytest
from rich.console import Console

from jouleswarm.common import invoked
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.facts import Counts
from jouleswarm.energy.repricing import Prices
from jouleswarm.report.answer import Said, answer, factor_text, factor_words, said
from jouleswarm.report.everyday import everyday
from jouleswarm.report.pages import part
from jouleswarm.report.report import report
from jouleswarm.report.screen import commands, panel
from jouleswarm.report.tables import rewards_table
from jouleswarm.runs.answer import answer_of
from jouleswarm.runs.directory import STATE, SUMMARY
from jouleswarm.runs.run import load_run
from jouleswarm.runs.summary import summarise


@pytest.fixture
def learned(write_run, facts) -> Path:
    facts.rows[:] = [row if row.learned is None else row.model_copy(update={"learned": True}) for row in facts.rows]
    return write_run(summarise(facts.scenario, facts.rows, facts.meter_rows))


@pytest.fixture
def unlearned(write_run, facts) -> Path:
    """Task 2 was not learned without transfer."""
    return write_run(summarise(facts.scenario, facts.rows, facts.meter_rows))


def words(path: Path, energy: Energy | None = None) -> tuple[str, dict[str, str]]:
    """Title, and the lines of the answer; of several with one name the last."""
    run = load_run(path)
    energy = energy or run.scenario.energy
    told = said(run, energy, answer(run, energy))
    return told.title, dict(told.lines)


def screen(path: Path, width: int, prices: Prices | None = None) -> list[str]:
    console = Console(file=io.StringIO(), width=width)
    report(path, prices, console=console)
    return console.file.getvalue().splitlines()  # type: ignore[attr-defined,no-any-return]


def test_the_title_has_the_factor_and_both_totals(learned) -> None:
    assert words(learned)[0] == "MAML costs 1.3 times as much as FL, no transfer: 3.188 kJ against 2.453 kJ"


def test_the_cause_is_told_with_its_share_and_the_rounds_with_their_arms(learned) -> None:
    _, lines = words(learned)
    assert lines["why"] == "74% of what MAML costs is computing in the data center"  # 2364.72 / 3187.92
    assert lines["learned"] == (
        "all 2 tasks by both: MAML in 10 rounds after 3 in the data center; FL, no transfer in 30 rounds"
    )


def test_path_errors_are_told_beside_what_was_learned(write_run, facts) -> None:
    # a task's two robots are 1 and 1.5 m off, 1.25 m in the mean; those of task 2 without transfer 3 m each
    far = [(row.arm, row.task) == ("fl", 2) for row in facts.rows]
    moved = zip(facts.rows, far, strict=True)
    facts.rows[:] = [row.model_copy(update={"rmse_m": 3.0}) if is_far else row for row, is_far in moved]
    path = write_run(summarise(facts.scenario, facts.rows, facts.meter_rows))
    assert words(path)[1]["path error"] == (
        "RMSE at the end: MAML 1.25 m (worst task 1.25 m); FL, no transfer 2.12 m (worst task 3.00 m)"
    )
    arms = json.loads((path / SUMMARY).read_text())["answer"]["arms"]
    assert (arms["fl"]["rmse_m"], arms["fl"]["worst_rmse_m"]) == (2.125, 3.0)  # (1.25 + 3) / 2
    table = rewards_table(load_run(path))
    assert [row[-1] for row in table.rows] == ["1.25/1.25", "2.12/3.00"]
    assert table.headings[-1] == "RMSE, mean/worst task"


def test_where_there_is_no_path_there_is_no_path_error(write_run, facts) -> None:
    facts.rows[:] = [row.model_copy(update={"rmse_m": None}) for row in facts.rows]
    path = write_run(summarise(facts.scenario, facts.rows, facts.meter_rows))
    assert "path error" not in words(path)[1]
    assert rewards_table(load_run(path)).headings == ["arm", "task 1", "task 2"]


def test_a_tiny_uplink_makes_frames_the_largest_cause(learned) -> None:
    _, lines = words(learned, Energy(ul_bit_per_j=100))  # 120,000 B up and 20,000 B down: 9600 and 1600 J
    assert lines["why"] == "67% of what MAML costs is raw frames on the uplink"  # of 9600 + 1600 + 3182.32 J


def test_what_would_turn_it(learned) -> None:
    # the stage: 2364.72 + 4.8 J; a task saves (2452.8 - 817.6 - 0.8) / 2 = 817.2 J, so M* = 2369.52 / 817.2 = 2.9
    # sidelinks: 800 kbit by MAML, 2400 kbit without; 738.32 J = 1600 kbit / E_SL
    assert words(learned)[1]["turns if"] == (
        "there were 3 tasks or more (here 2), or E_SL were below 2.167 kb/J (here 500); not by any E_UL"
    )


def test_where_it_pays_it_says_until_when(learned) -> None:
    title, lines = words(learned, Energy(p0_w=295.0))  # half of 590 W: 1182.36 J in the data center
    assert title == "MAML saves a factor of 1.2 over FL, no transfer: 2.006 kJ against 2.453 kJ"
    assert lines["turns if"].startswith("there were fewer than 2 tasks (here 2)")  # M* = 1187.16 / 817.2 = 1.45


def test_a_bill_at_unequal_reward_is_no_verdict(unlearned) -> None:
    title, lines = words(unlearned)
    assert title == (
        "No verdict: FL, no transfer did not learn all tasks, and joules at unequal reward cannot be compared"
    )
    assert lines["learned"] == (
        "MAML 2 of 2 tasks in 10 rounds after 3 in the data center; FL, no transfer 1 of 2 tasks in 30 rounds"
    )
    assert "turns if" not in lines


def test_one_arm_has_its_own_sentence(write_run, facts) -> None:
    path = write_run(summarise(facts.scenario, facts.rows, facts.meter_rows), methods=["fl"])
    assert words(path)[0] == "FL, no transfer learned 1 of 2 tasks; 2.453 kJ"


def test_an_interrupted_run_says_so_and_how_to_go_on(write_run) -> None:
    path = write_run()
    (path / STATE).mkdir()
    title, lines = words(path)
    assert title == "No verdict: the run is interrupted"
    assert "bytes were not counted" in lines["note"]
    assert dict(commands(load_run(path)))["go on with it"].endswith(f"run --resume {path}")


def test_other_prices_say_first_what_they_have_changed(learned) -> None:
    lines = screen(learned, 80, Prices(pue=3.34))  # twice the data center's: 3187.92 + 2364.72 J
    assert " ".join(" ".join(line.strip("│ ") for line in lines[1:3]).split()) == (
        "At these prices: MAML 3.188 to 5.553 kJ, FL, no transfer 2.453 to 2.453 kJ; now 2.3 times, was 1.3"
    )


@pytest.mark.parametrize("width", [60, 80])
def test_the_screen_is_short_and_nothing_is_cut(learned, width: int) -> None:
    lines = screen(learned, width)
    end = next(place for place, line in enumerate(lines) if line.startswith("╰"))
    assert end < 21 or width < 80
    pasted = next(place for place, line in enumerate(lines) if line.startswith("run directory: "))
    assert max(map(len, lines[:pasted])) <= width
    assert "…" not in "".join(lines)
    assert lines[pasted].endswith(str(learned))  # in one piece, however long


def test_in_a_container_it_says_what_to_type_outside(learned, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(invoked.FETCH, "docker compose cp recorder:/runs/. runs")
    monkeypatch.setenv(invoked.PROGRAM, "docker compose run recorder jouleswarm")
    assert screen(learned, 80)[-4:] == [
        f"run directory: {str(learned)[1:]}",
        "fetch its files: docker compose cp recorder:/runs/. runs",
        f"all tables: docker compose run recorder jouleswarm report {learned} --details",
        f"other prices: docker compose run recorder jouleswarm report {learned} --ul 500 --sl 200",
    ]


def test_numbers_keep_their_units_at_the_end_of_a_line() -> None:
    told = Said("one two 374.2 kJ against 8.17 kJ", [])
    console = Console(file=io.StringIO(), width=20)
    console.print(panel(told, 20))
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert [line.strip("│ ") for line in lines[1:-1]] == ["one two 374.2 kJ", "against 8.17 kJ"]


def test_the_page_begins_with_the_answer(learned) -> None:
    run = load_run(learned)
    page = part("answer", said(run, run.scenario.energy, answer(run, run.scenario.energy)))
    assert page.startswith('<section class="answer"><h1>MAML costs 1.3 times as much as FL, no transfer')
    assert "<dt>why</dt><dd>74% of what MAML costs" in page


def test_the_summary_has_its_numbers(learned) -> None:
    found = json.loads((learned / SUMMARY).read_text())["answer"]
    assert found["arms"]["maml"]["largest_share"] == pytest.approx(2364.72 / 3187.92)
    (held,) = found["against"]
    assert held["factor"] == pytest.approx(3187.92 / 2452.8)
    assert held["pays_from_tasks"] == pytest.approx(2369.52 / 817.2)
    assert held["turns_at"] == {"sl_bit_per_j": pytest.approx(1600e3 / 738.32)}


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (46.1, "costs 46 times as much as"),
        (1.04, "costs 1.04 times as much as"),
        (1234.0, "costs 1,234 times as much as"),
        (1.001, "costs the same as"),
        (0.5, "saves a factor of 2 over"),
    ],
)
def test_factors_in_words(factor: float, told: str) -> None:
    assert factor_words(factor) == told
    assert factor_text(0.0213) == "0.021"


def test_joules_in_terms_of_every_day() -> None:
    # 375.5 kJ are 104.3 Wh, 6.95 times 15 Wh; 8.17 kJ are 2.27 Wh
    told = "0.104 kWh against 0.00227 kWh: a phone charged 7 against 0.15 times (15 Wh a charge)"
    assert everyday([375.5e3, 8.17e3]) == told
    assert everyday([883.1]) == "0.245 Wh: a phone charged 0.016 times (15 Wh a charge)"


def test_commands_name_the_program_as_the_shell_finds_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "venv" / "bin"
    folder.mkdir(parents=True)
    monkeypatch.setattr(sys, "executable", str(folder / "python"))
    monkeypatch.chdir(tmp_path)
    assert invoked.executable() == "venv/bin/python -m jouleswarm"
    (folder / "jouleswarm").touch(mode=0o755)
    monkeypatch.setenv("PATH", "/nowhere")
    assert invoked.executable() == "venv/bin/jouleswarm"
    monkeypatch.setenv("PATH", str(folder))
    assert invoked.executable() == "jouleswarm"
    monkeypatch.setenv(invoked.PROGRAM, "docker compose run --rm recorder jouleswarm")  # of a container
    assert invoked.executable() == "docker compose run --rm recorder jouleswarm"


def test_a_task_that_others_lose_again_is_no_break_even(learned) -> None:
    # task 1 alone was learned from: it saves, task 2 costs more; of one task the stage would be paid for
    run = load_run(learned)
    one = run.facts["maml"].parts["fl", 1]
    parts = {("ml", 0): Counts(gradients_robots=1), ("fl", 1): one, ("fl", 2): Counts(gradients_robots=2000)}
    sums = {"known_flows": None, "known_work": None, "known_sent": None}
    dear = dataclasses.replace(run.facts["maml"], parts=parts, **sums)
    scenario = run.scenario.model_copy(update={"meta": run.scenario.meta.model_copy(update={"training_tasks": (1,)})})
    held = {"maml": dear, "fl": run.facts["fl"]}
    (found,) = answer_of(scenario, held, run.results, scenario.energy, run.price_lists).against
    assert found.factor > 1
    assert found.pays_from_tasks is None
