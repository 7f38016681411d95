"""One description of a table, shown in four ways."""

import io
import re

import pytest
from rich.console import Console

from jouleswarm.chaos.plan import Fault
from jouleswarm.chaos.table import chaos_csv, chaos_table
from jouleswarm.report.pages import part
from jouleswarm.report.table import Table, csv_text, markdown_text, show, terminal

TABLE = Table(
    "E <J> [kJ]",
    ("arm", "E", "rounds", "held"),
    [("a|b", 1234.5678, 12, None), ("[bold]c", 0.0123456789, 3, True)],
    ("Lower is better.",),
    {1: "bold"},
)


def test_for_programs_numbers_have_six_digits_and_what_is_not_known_is_empty() -> None:
    assert csv_text(TABLE) == "arm,E,rounds,held\na|b,1234.57,12,\n[bold]c,0.0123457,3,True\n"


def test_for_readers_numbers_have_three_digits_and_bars_are_no_columns() -> None:
    lines = ["### E <J> [kJ]", "", "| arm | E | rounds | held |", "| --- | ---: | ---: | ---: |"]
    lines += ["| a\\|b | 1234.6 | 12 | - |", "| [bold]c | 0.0123 | 3 | True |", "", "Lower is better.", ""]
    assert markdown_text([TABLE]) == "\n".join(lines)
    assert markdown_text([TABLE, TABLE]) == "\n".join(lines + lines)


def test_a_pages_rows_have_their_style_as_class_and_nothing_of_theirs_is_markup() -> None:
    page = part("table", TABLE).strip()
    assert page.startswith('<h2>E &lt;J&gt; [kJ]</h2><div class="wide"><table class="cards">')
    first, second = re.findall("<tr.*?</tr>", page)[1:]
    assert re.findall("<td.*?>(.*?)</td>", first) == ["a|b", "1234.6", "12", "-"]
    assert second.startswith('<tr class="bold"><td data-h="arm">[bold]c</td>')
    assert page.endswith("<p>Lower is better.</p>")


def test_a_terminal_shows_the_same_text_and_takes_none_of_it_for_markup() -> None:
    console = Console(file=io.StringIO(), width=80)
    console.print(terminal(TABLE))
    assert isinstance(console.file, io.StringIO)
    shown = [line.split() for line in console.file.getvalue().splitlines() if line.strip()]
    assert shown[0] == ["E", "<J>", "[kJ]"]
    assert ["a|b", "1234.6", "12", "-"] in shown
    assert ["[bold]c", "0.0123", "3", "True"] in shown
    assert shown[-1] == ["Lower", "is", "better."]


def test_faults_are_told_to_readers_and_to_programs() -> None:
    faults = [
        Fault("robot killed", "federated", "agent-1", "one", 2.345, 1.25, identical=True, conserved=False),
        Fault("disk full", "federated", "the disk", "two", 4.0, note="no space left"),
    ]
    table = chaos_table(faults)
    assert table.title == "2 faults, 1 of them in runs with an identical end"
    assert list(table.rows) == [
        ("one", "federated", "robot killed", "agent-1", "1.2", "yes", "NO", ""),
        ("two", "federated", "disk full", "the disk", "-", "?", "?", "no space left"),
    ]
    first, second = chaos_csv(faults).splitlines()[1:]
    assert first == "one,federated,robot killed,agent-1,2.35,1.25,True,False,"
    assert second == "two,federated,disk full,the disk,4.00,,,,no space left"


@pytest.mark.parametrize("width", [40, 60, 80, 200])
def test_a_table_that_is_too_wide_becomes_several_and_nothing_is_cut(width: int) -> None:
    headings = ["arm", *(f"computing, number {place}" for place in range(7))]
    rows = [[f"arm {arm}", *(f"{arm}{place}00.5 kJ" for place in range(7))] for arm in range(3)]
    console = Console(file=io.StringIO(), width=width)
    show(Table("Wide", headings, rows), console)
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue()
    assert "…" not in text
    assert all(len(line) <= width for line in text.splitlines())
    assert all(cell in text for row in rows for cell in row)
    assert text.count("computing,") == 7
    assert text.count("arm 2") == {40: 4, 60: 2, 80: 2, 200: 1}[width]


def test_a_cell_of_several_words_is_not_cut_either() -> None:
    headings = ["arm", "paper (its t0)", "published prices", *(f"{word} sizes counted" for word in "abcd")]
    row = ["FL, no transfer", "-", "not defined here", "10.86 kJ", "1.42 kJ", "1.421 kJ", "883.6 J"]
    console = Console(file=io.StringIO(), width=80)
    show(Table("E", headings, [row]), console)
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue()
    assert all(cell in text for cell in row)
    assert all(len(line) <= 80 for line in text.splitlines())
