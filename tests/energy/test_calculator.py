"""The calculator: rows of somebody's own experiment, worked out by hand, and held against the audit's figures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.energy.calculator import facts_of
from jouleswarm.energy.facts import Counts, Facts
from jouleswarm.energy.rows import COUNTS, SETTINGS, example, read_rows
from jouleswarm.report.audit_rows import EFFICIENT_UPLINK, implied_bill, literal_bill
from jouleswarm.report.calculated import Calculated, calculate, document
from jouleswarm.runs.paper import TABLE_II

TABLE = Path(__file__).parents[2] / "examples" / "paper_table_ii.csv"


def csv(tmp_path: Path, *lines: str) -> Path:
    path = tmp_path / "counts.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def only(given: Any, **options: bool) -> Facts:
    (facts,) = facts_of(read_rows(given), **options).values()
    return facts


def joules(found: Calculated, name: str) -> list[float]:
    (bills,) = [bills for prices, bills in found.bills.items() if prices.name == name]
    return [bill.total_j for bill in bills.values() if bill]


def test_the_paper_s_table_ii_comes_to_the_audit_s_columns() -> None:
    found = calculate(TABLE)
    assert [facts.t0 for facts in found.facts.values()] == list(TABLE_II)
    assert joules(found, "literal") == pytest.approx(
        [literal_bill(t0, found.tariff.energy).total_j for t0 in TABLE_II], rel=1e-12
    )
    assert joules(found, "published") == pytest.approx([implied_bill(t0).total_j for t0 in TABLE_II], rel=1e-12)
    other = calculate(TABLE, changes=["energy.ul_bit_per_j=500e3", "energy.sl_bit_per_j=200e3"])
    assert joules(other, "literal") == pytest.approx(
        [literal_bill(t0, EFFICIENT_UPLINK).total_j for t0 in TABLE_II], rel=1e-12
    )
    assert [prices.name for prices in other.bills] == ["literal"]  # the paper implies nothing there


def test_break_even_of_table_ii_by_hand() -> None:
    told = {(prices.name, arm): tasks for prices, arm, _, tasks in calculate(TABLE).break_even_tasks}
    # t0 = 210: 210 x 4134.36 J; tasks 1, 2, 6 are seen and save 539.1 / 3 rounds each, the others 253.2 / 3
    seen, unseen = (rounds / 3 * 260.8 - 2 * 224 for rounds in (539.1, 253.2))
    assert told["literal", "MAML t0=210"] == pytest.approx(3 + (868_215.6 - 3 * seen) / unseen)
    assert told["published", "MAML t0=210"] == pytest.approx(210 * 352.4 / (539.1 / 3 * 246.3))


def test_a_stage_that_saves_nothing_never_pays() -> None:
    found = calculate({"batches": 20, "arms": {"a": {"rounds": 5}, "b": {"rounds": 5, "t0": 1, "training_robots": 1,
                                                                       "support_batches": 1}}})  # fmt: skip
    assert [tasks for *_, tasks in found.break_even_tasks] == [float("inf")]
    assert document(found)["break_even_tasks"] == {"literal": {"b": {"a": None}}}


def test_without_links_models_go_up_to_a_server_and_down() -> None:
    facts = only({"rounds": 3, "robots": 4, "model_bytes": 1000, "batches": 5})
    assert facts.counts.fl == Counts(gradients_robots=60, uplink_bytes=12_000, downlink_bytes=12_000)
    assert {(flow.sender, flow.receiver, flow.messages) for flow in facts.flows if flow.link == "uplink"} == {
        (f"agent-{robot}", "datacenter", 3) for robot in (1, 2, 3, 4)
    }


@pytest.mark.parametrize(
    ("robots", "links", "edges"), [(3, 6, {(1, 2), (1, 3), (2, 1), (2, 3), (3, 1), (3, 2)}), (2, 2, {(1, 2), (2, 1)})]
)
def test_with_links_weights_go_to_neighbours(robots: int, links: int, edges: set[tuple[int, int]]) -> None:
    facts = only({"rounds": 3, "robots": robots, "links": links, "model_bytes": 1000}, by_robot=True)
    assert facts.counts.fl == Counts(sidelink_bytes=links * 3000, sidelink_sent_bytes=robots * 3000)
    assert {(int(flow.sender[6:]), int(flow.receiver[6:])) for flow in facts.flows} == edges


def test_what_was_counted_comes_before_what_is_worked_out(tmp_path: Path) -> None:
    path = csv(
        tmp_path, "# mine", "what,value,robot,phase", "rounds,3,,", "robots,2,,", "batches,5,,", "model_bytes,1000,,",
        "uplink_bytes,700,1,", "uplink_bytes,300,1,", "gradients,8,,ml",
    )  # fmt: skip
    facts = only(path)
    assert facts.counts.fl == Counts(gradients_robots=30, uplink_bytes=1000)
    assert facts.counts.ml == Counts(gradients_support=8)


def test_robots_and_links_have_constants_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "links.csv").write_text("from,to,bit_per_j,j_per_message\n1,2,1000,\n2,1,500,0.5\n")
    (tmp_path / "my.toml").write_text('[energy]\nlinks = "links.csv"\n[[robots]]\nid = 2\npk_w = 10\ntk_batch_s = 1\n')
    path = csv(
        tmp_path, "what,value,robot,to", "gradients,3,1,", "gradients,3,2,", "sidelink_bytes,125,1,2",
        "sidelink_bytes,125,2,1", "sidelink_messages,4,2,1",
    )  # fmt: skip
    found = calculate(path, tmp_path / "my.toml", ["energy.prices=['literal', 'examples.cellular:Cellular']"])
    # 3 x 2.04 + 3 x 10 J; 1000 bit at 1000 and at 500 bit/J, 4 messages of 0.5 J
    assert joules(found, "literal") == pytest.approx([6.12 + 30 + 1 + 2 + 2])
    assert [prices.name for prices in found.bills] == ["literal", "cellular"]


def test_carbon_and_plain_data() -> None:
    changes = ["energy.robots_g_per_kwh=360", "energy.datacenter_g_per_kwh=36"]
    arm = document(calculate([{"what": "gradients", "value": 100}], changes=changes))["arms"]["experiment"]
    assert arm["energy_j"]["literal"]["by_cause"]["computing_robots"] == pytest.approx(204)
    assert arm["energy_j"]["literal"]["carbon_g"] == pytest.approx({"datacenter_g": 0, "robots_g": 0.0204})
    assert json.loads(json.dumps(arm))["counts"]["fl"]["gradients_robots"] == 100


def test_toml_json_and_rows_are_the_same(tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("batches = 5\nrobots = 2\n[arms.a.rounds]\n1 = 3\n2 = 4\n")
    (tmp_path / "c.json").write_text('{"batches": 5, "robots": 2, "arms": {"a": {"rounds": {"1": 3, "2": 4}}}}')
    path = csv(tmp_path, "arm,task,what,value", ",,batches,5", ",,robots,2", "a,1,rounds,3", "a,2,rounds,4")
    found = [only(each) for each in (tmp_path / "c.toml", tmp_path / "c.json", path)]
    assert found[0] == found[1] == found[2]
    assert found[0].counts.fl.gradients_robots == 70


def test_the_example_can_be_priced_and_has_every_word(tmp_path: Path) -> None:
    text = example()
    assert all(f"#   {what}: " in text for what in (*SETTINGS, *COUNTS))
    found = calculate(csv(tmp_path, text))
    # by the server: 120 rounds of 10 robots; 40, behind 30 rounds of a stage
    assert joules(found, "literal")[0] == pytest.approx(120 * 10 * (50 * 2.04 + 2 * 2.4e6 * 8 / 200e3))
    assert [facts.t0 for facts in found.facts.values()] == [0, 30]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["what", "rounds"], "line 1: 'what' lacks the column value"),
        (["what,value", "rounds,"], "line 2: value: Field required"),
        (["what,value", "rounds,-1"], "line 2: value: Input should be greater than or equal to 0, got '-1'"),
        (["what,value", "model_bytes,0"], "line 2: model_bytes is 0, expected more"),
        (["what,value", "rounds,nan"], "line 2: value: Input should be a finite number, got 'nan'"),
        (["what,value", "", "round,5"], "line 3: what: did you mean rounds?, got 'round'"),
        (["what,value", "robots,1.5"], "line 2: robots is 1.5, expected a whole number"),
        (["what,value", "rounds,5", "rounds,6"], "line 3: rounds stands in"),
        (["what,value,robot", "robots,2,", "gradients,5,3"], "line 3: robot 3 does not exist"),
        (["what,value,colour", "rounds,5,red"], "line 2: colour: Extra inputs are not permitted, got 'red'"),
        (["what,value", "rounds,5,6"], "line 2: 3 cells, expected 2"),
        (["what,value", "robots,2", "links,9", "rounds,1", "model_bytes,1"], "9 links between 2 robots, expected 2"),
        (["what,value", "uplink_messages,9"], "line 2: uplink_messages without uplink_bytes"),
        (["what,value,phase", "rounds,9,ml"], "line 2: rounds with a robot or phase ml"),
        (["what,what,value", "rounds,robots,5"], "line 1: expected each column once"),
        (["what,value", "rounds,5"], "arm experiment: rounds alone cost nothing, expected batches or model_bytes"),
        (["what,value", "rounds,5", "batches,1", "t0,9"], "t0 alone costs nothing, expected training_robots"),
        (["what,value,task", "batches,5,", "rounds,5,1", "robots,3,2"], "no rounds of task 2, expected them"),
        (["what,value"], "no rows, expected some"),
        ([""], "is empty, expected the columns what,value"),
    ],
)
def test_bad_input_is_one_line_that_says_where(tmp_path: Path, lines: list[str], said: str) -> None:
    with pytest.raises(ConfigurationError) as error:
        calculate(csv(tmp_path, *lines))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("energy", "said"),
    [
        ("[[robots]]\nid = 7\n", "robot 7: expected each once, and of 1 to 2"),
        ("[[robots]]\nid = 1\npk_w = -1\n", "robots.0.pk_w: Input should be greater"),
        ("[energy]\nul_bit_per_j = 0\n", "energy.ul_bit_per_j: Input should be greater"),
        ("[meta]\nt0 = 0\n", "expected tables [energy] and [[robots]] and nothing else"),
        ("[[robots]]\nid = 1\n", "line 3: uplink_bytes of nobody in particular"),
    ],
)
def test_bad_constants_are_one_line(tmp_path: Path, energy: str, said: str) -> None:
    (tmp_path / "my.toml").write_text(energy)
    with pytest.raises(ConfigurationError) as error:
        calculate(csv(tmp_path, "what,value", "robots,2", "uplink_bytes,5"), tmp_path / "my.toml")
    assert said in str(error.value)


def test_what_goes_down_is_the_tasks_not_the_stage_s() -> None:
    same = {"robots": 2, "model_bytes": 25_000, "links": 2, "batches": 1}
    staged = {"t0": 1, "training_robots": 1, "experience_bytes": 250_000, "rounds": 1}
    # 10 J up; 2 J down to the pair; a round is 2 x 2.04 + 2 x 0.4 J
    found = calculate(same | {"arms": {"with": staged, "without": {"rounds": 11}}})
    assert [tasks for prices, *_, tasks in found.break_even_tasks if prices.name == "literal"] == [
        pytest.approx(10 / (10 * 4.88 - 2))
    ]


def test_counts_of_no_task_are_the_only_one_s_or_all_together() -> None:
    counted = [{"what": "uplink_bytes", "value": 5}]
    assert list(only(counted).parts) == [("fl", 1)]
    several = [*counted, *({"what": "rounds", "value": 1, "task": task} for task in (1, 2))]
    assert list(only(several).parts) == [("fl", 0)]
