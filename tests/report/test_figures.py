"""Figures show the figures: bar heights and curves are read back from the drawings."""

from pathlib import Path

import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.figure_kinds import figure_kinds
from jouleswarm.report.bars import energy_figure, rounds_figure
from jouleswarm.report.curves import bytes_figure, rewards_figure
from jouleswarm.report.figures import inline_svgs, write_figures
from jouleswarm.report.look import looks_of
from jouleswarm.runs.run import Run, load_run
from jouleswarm.runs.summary import summarise


@pytest.fixture
def run(write_run, facts) -> Run:
    return load_run(write_run(summarise(facts.scenario, facts.rows, facts.meter_rows)))


@pytest.fixture
def interrupted(write_run) -> Run:
    return load_run(write_run())


def heights(axes: Axes) -> list[float]:
    return [bar.get_height() for bar in axes.patches]


def curves(figure: Figure) -> list[list[float]]:
    return [[float(y) for y in line.get_ydata()] for axes in figure.axes for line in axes.lines]


def test_energy_bars_are_learning_and_communication(run) -> None:
    stage, tasks, total = energy_figure(run, run.scenario.energy).axes
    assert heights(stage) == pytest.approx([2364.72, 5.6])
    with_maml = [326.4, 0.64, 489.6, 0.96]  # 4 and 6 rounds of 81.6 J and 0.16 J
    without = [816.0, 1.6, 1632.0, 3.2]  # 10 and 20 rounds
    assert heights(tasks) == pytest.approx([*with_maml, *without])
    assert heights(total) == pytest.approx([2364.72 + 816, 7.2, 2448.0, 4.8])


def test_round_bars(run) -> None:
    stage, tasks = rounds_figure(run, run.scenario.energy).axes
    assert (heights(stage), heights(tasks)) == ([3], [4, 6, 10, 20])
    assert [text.get_text() for text in tasks.texts] == ["4", "6", "10", "20 ×"]


def test_reward_panels_have_robots_clusters_and_target(run) -> None:
    figure = rewards_figure(run, run.scenario.energy)
    assert [axes.get_title() for axes in figure.axes] == ["task 1", "task 2"]
    drawn = curves(figure)
    assert [13.75, 27.5, 41.25, 55.0] in drawn  # R of task 1 with MAML: 55 x round / 4
    assert drawn.count([50.0, 50.0]) == 2


def test_byte_curves_leave_out_links_without_traffic(run) -> None:
    (axes,) = bytes_figure(run, run.scenario.energy).axes
    assert [line.get_label() for line in axes.lines] == ["uplink", "control"]
    assert [float(y) for y in axes.lines[0].get_ydata()][1:] == pytest.approx([0.06, 0.12])


def test_without_meter_rows_the_bars_are_the_closed_form(interrupted) -> None:
    _, tasks, _ = energy_figure(interrupted, interrupted.scenario.energy).axes
    # FL of task 1 with MAML: 4 rounds x 2 links x 5,565,072 B x 8 / 500 kb/J, in kJ
    assert heights(tasks)[1] == pytest.approx(4 * 2 * 5_565_072 * 8 / 500e3 / 1e3)


def test_each_figure_is_written_as_png_and_svg(run) -> None:
    written = write_figures(run, run.scenario.energy)
    names = ("energy", "rounds", "rewards", "learned", "bytes")
    drawn = [f"{name}.{kind}" for name in names for kind in ("png", "svg")]
    assert [path.name for path in written] == [*drawn, "learned.csv"]
    assert all(path.parent == run.path / "figures" and path.stat().st_size > 1000 for path in written)


def test_the_same_run_draws_the_same_svg(run) -> None:
    def drawn() -> list[bytes]:
        return [path.read_bytes() for path in write_figures(run, run.scenario.energy) if path.suffix == ".svg"]

    assert drawn() == drawn()


@pytest.mark.parametrize("what", ["no rows", "one task"])
def test_figures_of_runs_with_little_in_them(write_run, facts, what: str) -> None:
    if what == "no rows":
        facts.rows.clear()
        run = load_run(write_run())
    else:
        run = load_run(write_run(tasks=[{"id": 1, "map": "E .\n* .\nX ."}], methods=["fl"]))
    assert isinstance(run.path, Path)
    assert set(inline_svgs(run, run.scenario.energy)) == {"energy", "rounds", "rewards", "learned", "bytes"}


def test_figures_are_files_of_the_kinds_asked_for(run) -> None:
    written = write_figures(run, run.scenario.energy, kinds=figure_kinds("pdf"))
    assert {path.suffix for path in written} == {".pdf", ".csv"}
    assert all(path.read_bytes().startswith(b"%PDF") for path in written if path.suffix == ".pdf")


def test_a_kind_that_there_is_not_is_told() -> None:
    with pytest.raises(ConfigurationError, match="--figures png,gif: got 'gif', expected some of png, svg, pdf"):
        figure_kinds("png,gif")


def test_communication_keeps_its_hatch_in_svg_on_an_opaque_face_lighter_than_the_hatch(run) -> None:
    svg = inline_svgs(run, run.scenario.energy)["energy"]
    # 35% of MAML's #E69F00 on white: 255 - 0.35 x (255 - 230) = 246.25, 255 - 0.35 x 96 = 221.4, 255 - 0.35 x 255
    patterns = [each.split("</pattern>")[0] for each in svg.split("<pattern")[1:]]
    assert any('fill="#f6dda6"' in each and "#e69f00" in each for each in patterns)


def test_the_first_arms_differ_without_colour() -> None:
    looks = looks_of(["#000000"] * 9)
    assert len({look.hatch for look in looks}) == len({look.marker for look in looks}) == 9
    assert len({str(look.line) for look in looks[:7]}) == 7
