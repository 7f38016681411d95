"""Numbers in pages: they are what the committed tables come to, and none is typed by hand."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from jinja2 import Environment

from jouleswarm.common.errors import JouleSwarmError, StudyError
from jouleswarm.studies.engine import FACTS
from jouleswarm.studies.facts import read_facts, write_facts
from jouleswarm.studies.lookup import Results, Row
from jouleswarm.studies.written import (
    check,
    environment,
    fixed,
    listed,
    mean,
    pages_in,
    percent,
    pm,
    ratios,
    short_p,
    sums,
    times,
    write,
    written,
)

ROOT = Path(__file__).parents[2]
TEMPLATE = ROOT / "docs" / "results.md.j2"
TABLE = "t0,tasks,rounds,ci95\n0,seen,54.2,7.6\n0,unseen,41,\n90,seen,9.3,3.4\n90,unseen,30.4,inf\n"
NO_RESULTS = (
    r"t0(?: = \d+)?",
    r"E_UL = \d+|1/E_UL|1/E_SL|T_0|\(1 \+ gamma\)|beta = 1\b|eq. \(9\) is 1, as Table I",
    r"\(200, 500\)|\(500, 200\)",  # kb/J of the paper's pairs
    r"eqs?\. \(\d+\)(?: and \(\d+\))?",
    r"95%",
    r"cut (?:the bill )?by 2x|from which it is 1x|in round 0 or 1",  # what is asked
    r"\((?:1, 2, 6|3, 4, 5)\)",  # tasks
    r"\(5\.6 MB|96x72",  # Table I, and the input of its network
    r"arXiv \d+\.\d+|PIMRC 2021|Of the 2021 paper|et al\. 2023|those of 2023",
    r"from 100 to 400 kb/J|At 10 J a motion|350 gCO2e/kWh|and 50 at the robots|= 2 ms",  # prices that are tried
    r"1 or 2 seeds are an indication|Adam 2\.5e-4, target copied every 100$",
    r"target copied every 2000, epsilon 0\.1|(in|up to) 1000 rounds|the paper's 9x|^  4 or more in each",
    r"in round 0, where",
    r"With 1, 2, 3 and 6 tasks|1, 2, 4 and 8 robots|5, 10, 20 and 40 batches|Among 8 robots|random 3-regular",
    r"exploration of 10%|explore 30%|epsilon of 1e-8",
    r"same rounds and 3 neighbours|has 5 robots and by default 1 neighbour; ours 2 robots and 1\.",
)
"""What the sections of results say besides: what was set, cited or printed elsewhere."""


def typed(template: str) -> list[str]:
    """Lines of a template with digits that no expression has come to, what is no result left out."""
    code = r"\{#.*?#\}|\{\{.*?\}\}|\{%.*?%\}|```.*?```|`[^`]*`|\]\([^)]*\)"
    text = re.sub(code, lambda found: "..." + "\n" * found[0].count("\n"), template, flags=re.S)
    left = re.sub("|".join(NO_RESULTS), "", text, flags=re.M)
    return [line for line, less in zip(text.splitlines(), left.splitlines(), strict=True) if re.search(r"\d", less)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "results" / "small").mkdir(parents=True)
    (tmp_path / "results" / "small" / "table.csv").write_text(TABLE)
    (tmp_path / "results" / "notes.toml").write_text('[small]\ntook = "3 minutes"\n')
    return tmp_path


@pytest.fixture
def results(folder: Path) -> Results:
    return Results(folder / "results")


def test_committed_pages_hold_what_the_committed_results_come_to() -> None:
    pages = pages_in(ROOT)
    assert {ROOT / "README.md", ROOT / "docs" / "results.md"} <= set(pages)
    check(pages, Results(ROOT / "results"))


def test_no_result_is_typed_by_hand() -> None:
    results = TEMPLATE.read_text().split("\n## Studies\n")[0]
    assert typed(results) == []
    assert re.findall(r"\{\{\s*[-\"']?\d.*?\}\}", results) == []  # nor hidden in an expression
    assert [
        pattern for pattern in NO_RESULTS if not re.search(pattern, results, re.M)
    ] == []  # the list is no longer than it must be


def test_a_number_typed_by_hand_is_found() -> None:
    assert typed("It needs {{ 90 }} rounds, `--t0 90`,\nat t0 = 90\nand saves 58%.") == ["and saves 58%."]


def test_a_line_is_found_by_its_keys(results: Results) -> None:
    assert results.row("small/table", t0=90, tasks="seen")["rounds"] == 9.3
    assert [row["rounds"] for row in results.rows("small/table", tasks="seen", t0=[0, 90])] == [54.2, 9.3]
    assert results.row("small/table", ci95="")["rounds"] == 41  # an empty cell
    assert results.note("small", "took") == "3 minutes"


@pytest.mark.parametrize(
    ("expression", "told"),
    [
        ('row("small/none").x', "cannot be read (No such file or directory); RESULTS/small has table"),
        ('row("small/table", t0=66)', "no line with t0=66; of t0 there is 0, 90"),
        ('row("small/table", t0=90)', "2 lines with t0=90, expected one; say which by tasks, rounds, ci95"),
        ('row("small/table", task="seen")', "no column 'task', expected one of t0, tasks, rounds, ci95"),
        ('row("small/table", t0=0, tasks="seen").round', "line 2: no column 'round', expected one of t0, tasks"),
        ('row("small/table", t0=0, tasks="unseen").ci95 | fixed', "got an empty cell, expected a number"),
        ("nobody | fixed", "'nobody' is undefined"),
        ("1 / 0", "division by zero"),
        ('row("small/table"', "unexpected '}', expected ')'"),
        ('study("small").seeds', "study.json: cannot be read"),
        ('note("small", "cost")', "no small.cost, expected took in place of cost"),
    ],
)
def test_what_an_expression_names_and_is_not_there_is_told_with_its_line(
    folder: Path, results: Results, expression: str, told: str
) -> None:
    page = folder / "page.md"
    page.write_text(f"One\n\nIt is <!-- {{{{ {expression} }}}} -->1<!-- / -->\n")
    with pytest.raises(JouleSwarmError) as error:
        written(page, results)
    assert f"{page}, line 3: " in str(error.value)
    assert told in str(error.value).replace(str(folder / "results"), "RESULTS")


def test_a_page_with_spans_is_its_own_source(folder: Path, results: Results) -> None:
    page, expression = folder / "page.md", '<!-- {{ row("small/table", t0=0, tasks="seen").rounds | fixed }} -->'
    page.write_text(f"It took {expression}?<!-- / --> rounds.\n")
    assert write([page], results) == [page]
    assert page.read_text() == f"It took {expression}54<!-- / --> rounds.\n"
    assert write([page], results) == []


def test_a_span_without_an_end_is_told(folder: Path, results: Results) -> None:
    page = folder / "page.md"
    page.write_text("<!-- {{ 1 }} -->1, <!-- {{ 2 }} -->2<!-- / -->\n")
    with pytest.raises(JouleSwarmError, match="2 spans begin and not all end"):
        written(page, results)


def test_a_span_that_markdown_would_take_for_html_is_told(folder: Path, results: Results) -> None:
    page = folder / "page.md"
    page.write_text("- In all\n  <!-- {{ 1 + 1 }} -->2<!-- / --> rounds.\n")
    with pytest.raises(JouleSwarmError, match=r"page.md, line 2: a span begins the line"):
        written(page, results)


def test_a_page_with_a_template_is_written_from_it(folder: Path, results: Results) -> None:
    page = folder / "docs" / "page.md"
    page.parent.mkdir()
    page.with_name("page.md.j2").write_text(
        '{% for it in rows("small/table", tasks="seen") %}\n| {{ it.rounds | pm(it.ci95, 1) }} |\n{% endfor %}\n'
    )
    assert pages_in(folder) == [page]
    assert write([page], results) == [page]
    assert page.read_text() == "| 54.2 ± 7.6 |\n| 9.3 ± 3.4 |\n"


def test_the_first_line_that_differs_is_told(folder: Path, results: Results) -> None:
    page = folder / "page.md"
    page.write_text('a\nin <!-- {{ note("small", "took") }} -->2 minutes<!-- / -->\n')
    with pytest.raises(
        StudyError, match=r"page.md, line 2: got '.*2 minutes.*come to '.*3 minutes.*jouleswarm study write"
    ):
        check([page], results)
    assert write([page], results) == [page]
    check([page], results)


def test_a_table_at_other_prices_is_made_again(paper_results: Path) -> None:
    results = Results(paper_results.parent)

    def total(pk_w: float) -> float:
        rows = results.rows(
            f"{paper_results.name}/energy", f"energy.pk_w={pk_w}", t0=0, prices="literal", ul_kb_per_j=200
        )
        total_j = rows[0]["total_j"]
        assert isinstance(total_j, float)
        return total_j

    # Without a stage only robots compute: watts count once in proportion, and what is sent costs the same.
    sent, *both = (total(pk_w) for pk_w in (1e-6, 5, 10))
    assert both[1] - sent == pytest.approx(2 * (both[0] - sent), rel=1e-4)
    assert both[0] > sent


def test_a_table_at_other_prices_keeps_an_arm_apart_that_went_further_in_some_seeds(paper_results: Path) -> None:
    facts = read_facts(paper_results / FACTS)
    to_90 = [fact for fact in facts if fact.arm in ("maml-t90", "fl") and fact.seed == 1]
    as_last = [fact.model_copy(update={"seed": 77, "arm": fact.method}) for fact in to_90]
    write_facts(paper_results / FACTS, [*facts, *as_last])
    found = Results(paper_results.parent).rows(
        f"{paper_results.name}/uncertain", "energy.pue={low=1.5,high=2.0}", prices="literal"
    )
    arms = [row["arm"] for row in found]
    assert "maml" not in arms  # whose bill would be a mean over 240 rounds and 90
    assert {"maml-t90", "maml-t240", "fl"} <= set(arms)


def test_the_guide_has_every_name_that_an_expression_may_use(results: Results) -> None:
    ours, plain = environment(results), Environment()
    guide = (ROOT / "CONTRIBUTING.md").read_text()
    names = [*(ours.globals.keys() - plain.globals), *(ours.filters.keys() - plain.filters)]
    assert len(names) == 14
    assert [name for name in names if not re.search(rf"`[^`]*\b{name}\b[^`]*`", guide)] == []


def test_how_numbers_are_spelled() -> None:
    assert [fixed(1188.82), fixed(float("inf")), fixed(95.27, 1)] == ["1,189", "never", "95.3"]
    assert [pm(95.27, 12.5, 1), pm(117, None)] == ["95.3 ± 12.5", "117"]
    assert [times(2.402), percent(0.584), percent(0.003, 1)] == ["2.4x", "58%", "0.3%"]
    assert [short_p(value) for value in (0.3841, 1.84e-7, 1)] == ["0.38", "1.8e-07", "1"]
    assert [listed([59, 35, 38.2]), listed(["a"]), listed([0.5, 1.25], 1)] == ["59, 35 and 38", "a", "0.5 and 1.2"]


def test_sums_and_ratios_go_by_what_lines_share() -> None:
    rows = [Row({"seed": seed, "rounds": rounds}, "") for seed, rounds in (("1", "3"), ("2", "5"), ("1", "4"))]
    assert sums(rows, "rounds", by="seed") == {1: 7, 2: 5}
    assert mean(rows, "rounds") == 4
    assert ratios({1: 7, 2: 5, 3: 1}, {1: 14, 2: 2}) == [0.5, 2.5]
