"""Tables and figures from made-up facts."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from matplotlib.axes import Axes
from matplotlib.container import BarContainer

from jouleswarm.common.errors import ConfigurationError, StudyError
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.bill import Bill
from jouleswarm.energy.facts import Facts
from jouleswarm.energy.literal import literal
from jouleswarm.studies.catalogue import KINDS, kind_of
from jouleswarm.studies.codecs import codecs_figure
from jouleswarm.studies.engine import FACTS
from jouleswarm.studies.estimates import Estimate
from jouleswarm.studies.facts import Fact, processors_note, read_facts, write_facts
from jouleswarm.studies.kinds import write_csv_tables, write_outputs
from jouleswarm.studies.names import STUDIES
from jouleswarm.studies.paper_energy import EnergyRow, optimum
from jouleswarm.studies.record import RECORD, Record, read_record
from jouleswarm.studies.run import make_tables, reprice
from jouleswarm.studies.tables import estimate_text
from tests.studies.made_up import SEEDS, meta_fact, pair_of_arms, paper_facts, task_fact

Rows = list[dict[str, str]]


def rows_of(path: Path, **where: str) -> Rows:
    with path.open(newline="") as file:
        return [row for row in csv.DictReader(file) if all(row[key] == value for key, value in where.items())]


def test_the_paper_study_makes_its_tables_and_figures_from_facts_alone(made: Path) -> None:
    written = {path.name for path in made.iterdir()} - {FACTS, RECORD}
    tables = {"table2", "seen_unseen", "energy", "optimum", "breakeven", "ratios", "verdict", "curves", "why"}
    figures = {"fig3", "fig4a", "fig4b", "breakeven", "methods", "ratios", "curves", "why"}
    assert written == (
        {f"{name}.csv" for name in tables}
        | {f"{name}.md" for name in ("table2", "seen_unseen", "energy", "ratios", "verdict", "why")}
        | {f"{name}.{kind}" for name in figures for kind in ("png", "svg")}
    )
    assert (made / "fig4a.svg").read_text().startswith("<?xml")
    assert (made / "fig3.png").read_bytes().startswith(b"\x89PNG")


def test_table_2_has_mean_interval_and_printed_value_of_every_t0_and_task(made: Path) -> None:
    table = made / "table2.csv"
    assert len(rows_of(table)) == 3 * 7 * 7
    # Printed 29.7; made up as 30 + seed: 31, 32, 33, of which the interval is t(0.975, 2) / sqrt 3.
    (found,) = rows_of(table, measure="rounds", t0="42", task="1")
    assert (found["rounds"], found["ci95"], found["printed"]) == ("32", "2.48414", "29.7")
    (first,) = rows_of(table, measure="rounds_first", t0="42", task="1")
    assert first["rounds"] == "30"
    (total,) = rows_of(table, measure="rounds", t0="240", task="sum")
    assert total["printed"] == "104"


def test_a_task_that_was_not_learned_is_counted_and_not_dropped(made: Path) -> None:
    (found,) = rows_of(made / "table2.csv", measure="rounds", t0="0", task="1")
    assert (found["rounds"], found["not_learned"], found["trials"]) == ("382", "1", "3")
    for name in ("seen_unseen", "energy", "optimum", "breakeven"):
        assert {"not_learned", "trials"} <= rows_of(made / f"{name}.csv")[0].keys()
    assert "1 of 18" in (made / "table2.md").read_text()
    assert "1 of 18" in (made / "energy.md").read_text()
    assert "| fl | 0 | ≥ 382.0 ± 2.48 (380.1) | 132.0 ± 2.48 (129.6) |" in (made / "table2.md").read_text()


def test_energy_is_priced_for_both_pairs_and_not_made_up_where_not_defined(made: Path) -> None:
    table = made / "energy.csv"
    (literal,) = rows_of(table, ul_kb_per_j="200", prices="literal", t0="210")
    # 210 x (60 x 11.8 J x 1.67 + 3 x 24.6 MB x 8 / 200 kb/J), and 12 x 5.6 MB x 8 / 200 kb/J down
    assert float(literal["ml_j"]) == pytest.approx(210 * (1182.36 + 2952) + 2688, rel=1e-5)
    (published,) = rows_of(table, ul_kb_per_j="200", prices="published", t0="210")
    assert float(published["ml_j"]) == pytest.approx(74_004)
    assert (published["printed_ml_j"], published["printed_total_j"]) == ("74000", "106000")
    (undefined,) = rows_of(table, ul_kb_per_j="500", prices="published", t0="210")
    assert undefined["total_j"] == ""


def test_the_optimum_is_the_lowest_mean_and_may_be_no_meta_learning() -> None:
    rows = [
        EnergyRow(t0, Estimate(0, None, 1), Estimate(0, None, 1), Estimate(total, None, 1))
        for t0, total in ((0, 5.0), (42, 7.0), (66, 6.0))
    ]
    assert optimum(rows).t0 == 0
    assert optimum(rows, with_meta=True).t0 == 66


def test_break_even_is_infinite_where_adaptation_saves_nothing(tmp_path: Path, scenario: Scenario) -> None:
    facts = pair_of_arms("", 1, with_meta=30, without=20)
    record = Record(study="paper", profile="compact", scenario=scenario, seeds=(1,), t0=0)
    write_csv_tables(tmp_path, kind_of("paper").outputs(facts, record))
    found, papers = rows_of(tmp_path / "breakeven.csv", ul_kb_per_j="200", prices="literal")
    assert (found["sizes"], papers["sizes"]) == ("counted", "paper")
    assert found["break_even_tasks"] == papers["returns"] == "inf"


def test_the_same_facts_make_the_same_files(made: Path, paper_results: Path) -> None:
    for path in make_tables(paper_results, ["svg"]):
        assert path.read_bytes() == (made / path.name).read_bytes(), path.name


def test_a_sweep_has_a_line_a_variant_and_arm_and_a_figure_a_group(tmp_path: Path, scenario: Scenario) -> None:
    name = "sensitivity"
    facts = [
        *(fact for seed in (1, 2) for fact in pair_of_arms("base", seed, 10, 20)),
        *pair_of_arms("robots=1", 1, 10, 40),
    ]
    groups = {"robots": {"1": "robots=1", "2": "base", "4": "robots=4"}, "Q": {"3": "base"}}
    training = {"robots=1": (1, 2)}
    made_of = {"seeds": (1, 2), "t0": 42, "groups": groups, "training": training}
    record = Record(study=name, profile="compact", scenario=scenario, **made_of)
    written = {path.name for path in write_outputs(tmp_path, kind_of(name).outputs(facts, record))}
    assert {f"{name}.csv", f"{name}.md", f"{name}_robots.svg", f"{name}_Q.png"} <= written
    assert {"curves.csv", "curves_robots.svg", "curves_Q.png", "why.csv", "why.md", "why.svg"} <= written
    curves = rows_of(tmp_path / "curves.csv", spent="joules")
    assert {(row["variant"], row["arm"], row["t0"]) for row in curves} == {
        (variant, *arm) for variant in ("base", "robots=1") for arm in (("fl", "0"), ("maml", "42"))
    }
    (line,) = rows_of(tmp_path / f"{name}.csv", variant="robots=1", arm="fl")
    # Six tasks of 40 + task rounds, 2 x 20 batches of 2.04 J and 2 x 5.6 MB at 500 kb/J a round.
    assert (line["rounds"], line["success"], line["seeds"]) == ("261", "1", "1")
    # This variant has been trained on tasks 1 and 2 alone: 41 + 42, and 43 to 46.
    assert (line["rounds_seen"], line["rounds_unseen"], line["copied_seen"]) == ("83", "178", "0")
    assert float(line["robots_j"]) == pytest.approx(261 * 40 * 2.04, rel=1e-5)
    assert float(line["sidelink_j"]) == pytest.approx(261 * 179.2, rel=1e-5)
    assert float(line["bits"]) == pytest.approx(261 * 89.6e6, rel=1e-5)


def test_baselines_stand_side_by_side_with_success_rates(tmp_path: Path, scenario: Scenario) -> None:
    isolated = Arm("isolated", "isolated", 0)
    facts: list[Fact] = [
        *pair_of_arms("", 1, 10, 20),
        *(task_fact(isolated, task, 200, learned=task < 4, sidelink_bytes=0) for task in range(1, 7)),
        task_fact(Arm("fl", "fl", 0), 1, 70, variant="robots=1", robots=1, gradients_robots=1400, sidelink_bytes=0),
    ]
    record = Record(study="baselines", profile="compact", scenario=scenario, seeds=(1,), t0=42)
    write_outputs(tmp_path, kind_of("baselines").outputs(facts, record), ["svg"])
    (found,) = rows_of(tmp_path / "baselines.csv", arm="isolated")
    assert (found["success"], found["not_learned"], found["trials"]) == ("0.5", "3", "6")
    text = (tmp_path / "baselines.md").read_text()
    assert "3 of 6" in text
    # fl: 141 rounds of 40 gradients of 2.04 J and 11.2 MB at 500 kb/J; one robot a task: 70 of 20 gradients alone.
    assert "at their cheapest: fl with robots=1, 2.86 kJ by the equations; fl, which transfer is" in text
    assert (tmp_path / "baselines.svg").exists()
    curves = (tmp_path / "curves.svg").read_text()
    assert all(f"<!-- {arm} -->" in curves for arm in ("fl", "isolated", "maml"))


def test_the_zero_shot_share_stands_in_every_studys_tables_where_robots_tried_before_learning(
    tmp_path: Path, scenario: Scenario
) -> None:
    plain = Arm("fl", "fl", 0)
    facts = [
        task_fact(plain, task, 0 if task == 2 else 9, seed, evaluation_motions=4) for seed in (1, 2) for task in (1, 2)
    ]
    facts += [fact.model_copy(update={"arm": "isolated", "evaluation_motions": None}) for fact in facts]
    facts[1] = facts[1].model_copy(update={"learned": False})  # in seed 1 task 2 was given up before its first round
    for name in ("baselines", "paper"):
        record = Record(study=name, profile="compact", scenario=scenario, seeds=(1, 2), t0=0)
        write_csv_tables(tmp_path, kind_of(name).outputs(facts, record))
    told = {row["arm"]: (row["zero_shot"], row["fl_j"]) for row in rows_of(tmp_path / "baselines.csv")}
    # One of two tasks in seed 2 and none in seed 1; 9 rounds of 260.8 J of the other one, and none of this.
    assert told == {"fl": ("0.25", "2347.2"), "isolated": ("", "2347.2")}
    (task_2,) = rows_of(tmp_path / "table2.csv", measure="rounds", task="2")
    assert (task_2["rounds"], task_2["zero_shot"]) == ("0", "0.5")
    (seen,) = rows_of(tmp_path / "seen_unseen.csv", measure="rounds", tasks="seen")
    assert seen["zero_shot"] == "0.25"


def test_similarity_sets_what_transfer_saves_against_what_paths_share(tmp_path: Path, scenario: Scenario) -> None:
    facts = [fact for seed in (1, 2) for fact in pair_of_arms("stem=3", seed, 10, 10 * seed + 10)]
    values = {"stem=3": {1: 0.4, 2: 0.5}}
    record = Record(study="similarity", profile="compact", scenario=scenario, seeds=(1, 2), t0=42, values=values)
    write_outputs(tmp_path, kind_of("similarity").outputs(facts, record))
    # Rounds of six tasks: 60 + 21 with, 120 + 21 and 180 + 21 without.
    rows = rows_of(tmp_path / "gains.csv")
    gains = [(row["similarity"], float(row["gain"])) for row in rows]
    assert gains == [("0.4", pytest.approx(141 / 81, rel=1e-5)), ("0.5", pytest.approx(201 / 81, rel=1e-5))]
    # Unseen 3, 4 and 5: 60 + 12 over 30 + 12; seen 1, 2 and 6: 60 + 9 over 30 + 9.
    assert float(rows[0]["gain_unseen"]) == pytest.approx(72 / 42, rel=1e-5)
    assert float(rows[0]["gain_seen"]) == pytest.approx(69 / 39, rel=1e-5)
    assert (tmp_path / "similarity.png").exists()


def test_every_study_on_the_command_line_is_there() -> None:
    assert list(KINDS) == list(STUDIES)
    with pytest.raises(StudyError, match="got a study called 'x', expected one of paper"):
        kind_of("x")


def test_the_command_line_says_the_defaults_of_every_study() -> None:
    for name, kind in KINDS.items():
        assert f"{kind.seeds} seeds" in STUDIES[kind.name], name
        assert not kind.t0 or f"t0 = {kind.t0}." in STUDIES[kind.name], name


def heights(axes: Axes) -> list[float]:
    bars = [held for held in axes.containers if isinstance(held, BarContainer)]
    return [float(height) for held in bars for height in held.datavalues]


def test_encodings_are_one_figure_of_what_they_change(tmp_path: Path, scenario: Scenario) -> None:
    facts = [fact for variant in ("base", "weights=int8") for fact in pair_of_arms(variant, 1, 10, 20)]
    groups = {"weights": {"float32": "base", "int8": "weights=int8"}, "experience": {"raw": "base"}}
    record = Record(study="codecs", profile="compact", scenario=scenario, seeds=(1,), t0=42, groups=groups)
    unseen, seen, gbit, kilojoules, *below = codecs_figure(facts, record).axes
    # Tasks 3, 4 and 5 take 10 + task rounds, 1, 2 and 6 the others; 20 + task without.
    assert heights(unseen) == [42, 42, 72, 72]
    assert heights(seen) == [39, 39, 69, 69]
    # Six tasks of 10 + task rounds (81), two neighbours of 5.6 MB a round, and 12 x 5.6 MB down; 141 rounds without.
    assert heights(gbit)[:2] == pytest.approx([(81 * 2 + 12) * 0.0448] * 2)
    assert heights(gbit)[2:] == pytest.approx([141 * 2 * 0.0448] * 2)
    # 81 x 11.2 MB at 500 kb/J, 67.2 MB at 200 kb/J.
    assert heights(kilojoules)[:2] == pytest.approx([81 * 0.1792 + 2.688] * 2)
    assert [label.get_text() for label in unseen.get_xticklabels()] == ["float32", "int8"]
    # Below, experience: 42 rounds of 3 x 24.6 MB, and nothing without.
    assert heights(below[2]) == pytest.approx([42 * 3 * 0.1968])


def test_carbon_stands_beside_joules_where_an_intensity_is_set(tmp_path: Path, scenario: Scenario) -> None:
    energy = scenario.energy.model_copy(update={"datacenter_g_per_kwh": 360.0, "robots_g_per_kwh": 36.0})
    record = Record(
        study="sensitivity",
        profile="compact",
        scenario=scenario.model_copy(update={"energy": energy}),
        seeds=(1,),
        t0=42,
    )
    write_outputs(tmp_path, kind_of("sensitivity").outputs(pair_of_arms("base", 1, 10, 20), record), kinds=())
    (line,) = rows_of(tmp_path / "sensitivity.csv", arm="maml")
    # 42 x 60 gradients of 11.8 J at PUE 1.67 and 12 x 5.6 MB down at 200 kb/J, at 0.1 g/kJ;
    # 81 rounds of 40 gradients of 2.04 J and 11.2 MB at 500 kb/J, and 42 x 73.8 MB up at 200 kb/J, at 0.01 g/kJ.
    center, robots = (42 * 1182.36 + 2688) * 1e-4, (81 * (81.6 + 179.2) + 42 * 2952) * 1e-5
    assert float(line["datacenter_g"]) == pytest.approx(center, rel=1e-5)
    assert float(line["robots_g"]) == pytest.approx(robots, rel=1e-5)
    assert float(line["total_g"]) == pytest.approx(center + robots, rel=1e-5)
    assert "| gCO2e |" in (tmp_path / "sensitivity.md").read_text()


def test_a_study_is_priced_again_in_another_folder(paper_results: Path, tmp_path: Path) -> None:
    before = {path.name: path.read_bytes() for path in paper_results.iterdir()}
    out = tmp_path / "again"
    reprice(paper_results, ["energy.robots_g_per_kwh=36", "energy.pue=2"], out, kinds=())
    assert {path.name: path.read_bytes() for path in paper_results.iterdir()} == before
    (found,) = rows_of(out / "energy.csv", ul_kb_per_j="200", prices="literal", t0="210")
    assert float(found["ml_j"]) == pytest.approx(210 * (60 * 11.8 * 2 + 2952) + 2688, rel=1e-5)
    assert (found["datacenter_g"], found["total_g"]) == ("", "")  # that site's intensity is not known
    (published,) = rows_of(out / "energy.csv", ul_kb_per_j="200", prices="published", t0="210")
    assert published["robots_g"] == ""  # the published prices do not tell sites apart


@pytest.mark.parametrize(
    ("changes", "out", "message"),
    [
        (["meta.t0=42"], "again", "--set meta.t0=42: expected energy.KEY=VALUE"),
        (["energy.pue=2"], "results", "expected --out FOLDER"),
        (["energy.pue=2"], None, "expected --out FOLDER"),
        (["energy.pue=0"], "again", "energy.pue: .*got 0"),
        (["energy.loss=0.1"], "again", "energy: got loss, idle power, .*a study keeps sums alone"),
        (["energy.beta=measured"], "again", "beta of maml was not measured in this run"),
    ],
)
def test_what_cannot_be_priced_again_is_refused_and_nothing_written(
    changes: list[str], out: str | None, message: str, paper_results: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError, match=message):
        reprice(paper_results, changes, tmp_path / out if out else None)
    assert {path.name for path in tmp_path.iterdir()} == {"results"}


class Twice:
    name, label = "twice", "twice the equations"

    def price(self, facts: Facts, energy: Energy) -> Bill:
        once = literal.price(facts, energy)
        return once + once


OWN = {"prices": ["literal", "published", "tests.studies.test_outputs:Twice", "examples.cellular:Cellular"]}


def with_own_lists(scenario: Scenario) -> Scenario:
    energy = scenario.energy.model_copy(update={"prices": tuple(OWN["prices"])})
    return scenario.model_copy(update={"energy": energy})


def test_own_price_lists_are_in_every_table_and_figure_of_the_paper_study(tmp_path: Path, scenario: Scenario) -> None:
    record = Record(study="paper", profile="compact", scenario=with_own_lists(scenario), seeds=SEEDS, t0=0)
    written = {path.name for path in write_outputs(tmp_path, kind_of("paper").outputs(paper_facts(), record), ["svg"])}
    for name, ratio in (("energy", ("ml_j", "fl_j", "total_j")), ("breakeven", ("stage_j", "plain_task_j"))):
        (ours, *_), (its, *_) = (
            rows_of(tmp_path / f"{name}.csv", ul_kb_per_j="500", prices=prices, t0="210")
            for prices in ("literal", "twice")
        )
        assert [float(its[part]) / float(ours[part]) for part in ratio] == pytest.approx([2] * len(ratio), rel=1e-5)
        # Messages are not among the facts of a study.
        (unknown, *_) = rows_of(tmp_path / f"{name}.csv", ul_kb_per_j="500", prices="cellular", t0="210")
        assert [unknown[part] for part in ratio] == [""] * len(ratio)
    text = (tmp_path / "energy.md").read_text()
    assert "### Energy (kJ), E_UL/E_SL = 200/500 kb/J, twice the equations" in text
    assert "This price list has no bill for these facts" in text
    assert {"breakeven.svg", "breakeven-twice.svg", "breakeven-cellular.svg"} <= written
    assert "twice the equations" in (tmp_path / "fig3.svg").read_text()
    assert "cellular, 0.9 J a message" in (tmp_path / "fig4a.svg").read_text()


def test_own_price_lists_are_in_every_table_and_figure_of_a_comparison(tmp_path: Path, scenario: Scenario) -> None:
    facts = [fact for variant in ("base", "weights=int8") for fact in pair_of_arms(variant, 1, 10, 20)]
    own, groups = with_own_lists(scenario), {"weights": {"float32": "base", "int8": "weights=int8"}}
    for name, figure in (("sensitivity", "sensitivity_weights"), ("baselines", "baselines"), ("codecs", "codecs")):
        record = Record(study=name, profile="compact", scenario=own, seeds=(1,), t0=42, groups=groups)
        write_outputs(tmp_path, kind_of(name).outputs(facts, record), ["svg"])
        for line in rows_of(tmp_path / f"{name}.csv"):
            assert float(line["twice_j"]) == pytest.approx(2 * float(line["total_j"]), rel=1e-5)
            assert line["cellular_j"] == ""
        heading = "| E (kJ) | E (kJ), twice the equations | E (kJ), cellular, 0.9 J a message |"
        assert heading in (tmp_path / f"{name}.md").read_text()
        assert "twice the equations" in (tmp_path / f"{figure}.svg").read_text()


def test_a_study_priced_by_another_list_keeps_its_file(
    paper_results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.py").write_text(
        "from jouleswarm.energy.literal import Literal\nclass Mine(Literal): name = label = 'mine'\n"
    )
    monkeypatch.chdir(tmp_path)
    out = tmp_path / "again"
    reprice(paper_results, ['energy.prices=["mine:Mine"]'], out, kinds=())
    (tmp_path / "mine.py").unlink()
    make_tables(out, kinds=())
    assert {row["prices"] for row in rows_of(out / "energy.csv")} == {"mine"}


def test_facts_read_back_as_they_were_written(tmp_path: Path) -> None:
    facts = [
        meta_fact(Arm("maml-t42", "maml", 42), uplink_bytes=1 / 3),
        task_fact(Arm("fl", "fl", 0), 1, 9, variant="a,b", reward=None, learned=False),
    ]
    write_facts(tmp_path / FACTS, facts)
    assert read_facts(tmp_path / FACTS) == facts


def test_facts_from_before_the_processor_or_motions_were_noted_are_read(tmp_path: Path) -> None:
    fact = task_fact(Arm("fl", "fl", 0), 1, 9)
    write_facts(tmp_path / FACTS, [fact.model_copy(update={"processor": "one"})])
    for columns, read in ((6, fact), (5, fact.model_copy(update={"processor": "one"}))):
        before = [line.rsplit(",", columns)[0] for line in (tmp_path / FACTS).read_text().splitlines()]
        (tmp_path / "before.csv").write_text("\n".join(before) + "\n")
        assert read_facts(tmp_path / "before.csv") == [read]


def test_facts_of_several_processors_are_told() -> None:
    facts = [task_fact(Arm("fl", "fl", 0), 1, 9, processor=processor) for processor in ("one", "other", "one", "")]
    assert processors_note(facts[::2]) is None
    note = processors_note(facts)
    assert note is not None
    assert note.startswith("facts were computed on 3 kinds of processor (not noted; one; other)")


def test_damaged_facts_are_named_with_their_line(tmp_path: Path) -> None:
    path = tmp_path / FACTS
    write_facts(path, [task_fact(Arm("fl", "fl", 0), 1, 9)])
    text = path.read_text()
    path.write_text(text.replace(",9,", ",nine,"))
    with pytest.raises(StudyError, match=r"line 2: rounds: .*got 'nine'"):
        read_facts(path)
    path.write_text(text + "1,2\n")
    with pytest.raises(StudyError, match="line 3: 2 cells, expected 28"):
        read_facts(path)
    path.write_text("a,b\n")
    with pytest.raises(StudyError, match="got a,b, expected the columns variant,seed"):
        read_facts(path)


def test_a_folder_that_is_no_study_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"study\.json: cannot be read"):
        make_tables(tmp_path)
    (tmp_path / RECORD).write_text("{}")
    with pytest.raises(StudyError, match="damaged at study"):
        read_record(tmp_path)


def test_numbers_for_readers_keep_three_digits() -> None:
    assert estimate_text(Estimate(1234.56, 12.345, 3), 1e3) == "1.23 ± 0.0123"
    assert estimate_text(Estimate(56.78, None, 1)) == "56.8"
    assert estimate_text(None) == "-"
