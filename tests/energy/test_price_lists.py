"""Price lists of a user's own: what is taken, and what is said of one that cannot be used."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from jouleswarm.common.bus.agreement import terms
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.bill import CAUSES, PARTS, Bill, Cost, cause_parts, causes_of, parts, site_parts
from jouleswarm.energy.facts import STAGE, Counts, Facts, UnknownFactError
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import own_lists, price, price_lists
from jouleswarm.energy.published import published

MINE = """
from jouleswarm import literal
class Mine:
    name, label = "mine", "mine, 3 J more"
    def price(self, facts, energy):
        {body}
"""
MORE = 'return literal.price(facts, energy).plus(fl={"uplink_j": 3.0})'
FACTS = Facts("fl", "fl", t0=0, parts={("fl", 1): Counts(gradients_robots=10)})  # 10 x 5.1 W x 0.4 s = 20.4 J


def scenario(folder: Path, *prices: str, text: str = "") -> Scenario:
    (folder / "mine.py").write_text(text or MINE.format(body=MORE))
    tasks = [{"id": 1, "map": "E*\n.X"}]
    data = {"name": "x", "world": {"rows": 2, "cols": 2}, "tasks": tasks, "methods": ["fl"]}
    return scenario_from(data | {"energy": {"prices": list(prices)}}, "x", folder)


def refusal(folder: Path, *prices: str, text: str = "") -> str:
    with pytest.raises(ConfigurationError) as caught:
        price_lists(scenario(folder, *prices, text=text))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_lists_that_ship_here_are_the_default(tmp_path: Path) -> None:
    assert price_lists(scenario(tmp_path, *Energy().prices)) == (literal, published)


def test_a_list_in_a_file_beside_the_scenario_is_priced_like_ours(tmp_path: Path) -> None:
    ours, mine = price_lists(scenario(tmp_path, "literal", "mine:Mine"))
    assert (own_lists([ours, mine]), mine.label) == ([mine], "mine, 3 J more")
    bill = price(mine, FACTS, Energy())
    assert bill is not None
    assert (bill.total_j, bill.fl.uplink_j, bill.robots_j) == (pytest.approx(23.4), 3.0, pytest.approx(23.4))


def test_an_object_is_a_list_as_its_class_is(tmp_path: Path) -> None:
    (mine,) = price_lists(scenario(tmp_path, "mine:mine", text=MINE.format(body=MORE) + "mine = Mine()\n"))
    assert mine.name == "mine"


def test_a_file_that_changes_while_a_run_goes_on_changes_nothing(tmp_path: Path) -> None:
    found = scenario(tmp_path, "mine:Mine")
    price_lists(found)
    (tmp_path / "mine.py").write_text("raise SystemError('edited')\n")
    (mine,) = price_lists(found)
    assert mine.label == "mine, 3 J more"


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("return facts.joules", "price() fails on made-up facts: AttributeError: 'Facts' object has no attribute"),
        ("return 1 / 0", "price() fails on made-up facts: ZeroDivisionError: division by zero (line 6)"),
        ("return 3.0", "price() gave float for made-up facts, expected Bill or None"),
        (
            'return literal.price(facts, energy).plus(ml={"uplink_j": float("nan")})',
            "the bill of made-up facts does not add up: nan J over phases, nan J over causes, nan J over sites",
        ),
        ('return literal.price(facts, energy).plus(fl={"uplink_j": float("inf")})', "does not add up: inf J over"),
        (
            'return literal.price(facts, energy).plus(fl={"upwards_j": 1})',
            "ValueError: upwards_j: no such cause, expected computing_datacenter_j, computing_robots_j, uplink_j",
        ),
        (
            "return literal.price(energy, facts)",
            "AttributeError: 'Facts' object has no attribute 'is_uniform' (line 6)",
        ),
    ],
)
def test_a_list_that_fails_is_told_before_anything_starts(tmp_path: Path, body: str, says: str) -> None:
    said = refusal(tmp_path, "literal", "mine:Mine", text=MINE.format(body=body))
    assert said.startswith("price list 'mine:Mine': ")
    assert says in said


LISTS = {
    "no price": ("class Mine: name, label = 'mine', 'mine'", "has no price(facts, energy); see docs/doors.md"),
    "no name": (
        "class Mine:\n label = 'x'\n def price(self, facts, energy): return None",
        "its name is None, expected",
    ),
    "a name with a space": (
        "class Mine:\n name, label = 'my list', 'x'\n def price(self, facts, energy): return None",
        "its name is 'my list', expected letters, digits, _ and -",
    ),
    "no label": (
        "class Mine:\n name = 'm'\n def price(self, facts, energy): return None",
        "its label is None, expected",
    ),
    "a label of lines": (
        "class Mine:\n name, label = 'm', 'a\\nb'\n def price(self, facts, energy): return None",
        "its label is 'a\\nb', expected what heads its column",
    ),
    "a name of ours": (
        "class Mine:\n name, label = 'literal', 'x'\n def price(self, facts, energy): return None",
        "its name 'literal' is taken; give it another",
    ),
    "a key of summary.json": (
        "class Mine:\n name, label = 'by_cause', 'x'\n def price(self, facts, energy): return None",
        "its name 'by_cause' is taken; give it another",
    ),
    "arguments": (
        "class Mine:\n name, label = 'm', 'x'\n def __init__(self, joules): pass\n def price(self, f, e): return None",
        "Mine() fails: TypeError: ",
    ),
    "what does not import": (
        "import nowhere_at_all",
        "cannot be imported: ModuleNotFoundError: No module named 'nowhere",
    ),
    "another name": ("class Mina: pass", "has no Mine; did you mean Mina?"),
}


@pytest.mark.parametrize("case", LISTS)
def test_what_is_no_list_is_told_in_one_line(tmp_path: Path, case: str) -> None:
    text, says = LISTS[case]
    said = refusal(tmp_path, "mine:Mine", text=text)
    assert said.startswith("price list 'mine:Mine': ")
    assert says in said


def test_two_lists_are_told_apart_by_name_and_label(tmp_path: Path) -> None:
    other = MINE.format(body=MORE) + "class Same(Mine):\n    name = 'same'\n"
    said = refusal(tmp_path, "mine:Mine", "mine:Same", text=other)
    assert said == (
        "price list 'mine:Same': its name 'same' or label 'mine, 3 J more' is that of another list of energy.prices; "
        "give it others"
    )


def test_a_word_that_is_no_list(tmp_path: Path) -> None:
    assert refusal(tmp_path, "litteral") == (
        "price list 'litteral': expected distance, frames, literal, published, radio_states or module:name; did you "
        "mean literal?"
    )


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    says = f"price list 'nowhere:Mine': no nowhere.py in {tmp_path}, and no such module installed"
    assert refusal(tmp_path, "nowhere:Mine") == says


class Unlike(Bill):
    @property
    def total_j(self) -> float:
        return 5.0


def test_sums_that_are_unlike_are_no_bill() -> None:
    class Mine:
        name, label = "mine", "mine"

        def price(self, facts: Facts, energy: Energy) -> Bill:
            return Unlike(fl=Cost(uplink_j=4.0))

    says = "price list 'mine': the bill of arm fl does not add up: 5 J over phases, 4 J over causes, 4 J over sites"
    with pytest.raises(ConfigurationError, match=says):
        price(Mine(), FACTS, Energy())


def test_a_list_that_asks_for_what_is_not_known_has_no_bill() -> None:
    class Mine:
        name, label = "mine", "mine"

        def price(self, facts: Facts, energy: Energy) -> Bill:
            return Bill(fl=Cost(uplink_j=sum(flow.messages for flow in facts.flows)))

    with pytest.raises(UnknownFactError, match="flows: only sums are known"):
        _ = FACTS.flows
    assert price(Mine(), FACTS, Energy()) is None


def test_what_is_learned_does_not_depend_on_price_lists(tmp_path: Path) -> None:
    ours, mine = scenario(tmp_path, "literal"), scenario(tmp_path, "literal", "mine:Mine")
    assert set(mine.digests) == {"mine.py"}  # kept with the run
    assert (mine.determines, terms(mine)) == (ours.determines, terms(ours))


def test_more_of_a_cause_is_more_of_its_phase_and_site() -> None:
    bill = Bill(fl=Cost(downlink_j=1.0)).plus(ml={"other_robots_j": 2.0}, fl={"downlink_j": 0.5, "untold_j": 4.0})
    assert (bill.ml.total_j, bill.fl.total_j, bill.total_j) == (2.0, 5.5, 7.5)
    assert (bill.robots_j, bill.datacenter_j) == (2.0, 1.5)
    assert bill.sums_j == {"phases": 7.5, "causes": 7.5, "sites": 7.5}


def test_parts_of_a_bill_are_unknown_where_bytes_or_causes_are() -> None:
    bill = Bill(ml=Cost(computing_datacenter_j=3.0, uplink_j=4.0), fl=Cost(untold_j=5.0))
    assert parts(bill) == dict(zip(PARTS, (3.0, 4.0, 7.0, None, None, 5.0, 12.0), strict=True))
    assert parts(bill, metered=False) == dict(zip(PARTS, (3.0, None, None, None, None, None, None), strict=True))
    assert set(parts(None).values()) == {None}
    assert site_parts(bill.ml) == {"datacenter": 3.0, "robots": 4.0}
    assert site_parts(bill.ml, metered=False) == site_parts(bill.fl) == {"datacenter": None, "robots": None}
    told = [cause_parts(bill.ml, metered=False)[cause] for cause in CAUSES]
    assert told == [3.0, 0.0, None, None, None, 0.0, 0.0, 0.0, None]
    assert set(cause_parts(bill.fl).values()) == {None}


def test_other_causes_are_named_where_there_are_any() -> None:
    assert [cause.key for cause in causes_of([Cost(uplink_j=1.0), None])] == [
        "computing_datacenter", "computing_robots", "uplink", "downlink", "sidelink",
    ]  # fmt: skip
    assert causes_of([Cost(), Cost(other_robots_j=1.0)])[-1].key == "other"


def test_facts_of_a_phase_and_of_a_task() -> None:
    ml, first, second = Counts(uplink_bytes=1), Counts(gradients_robots=2), Counts(sidelink_bytes=4)
    facts = Facts(
        "maml", "maml", t0=3, parts={("ml", STAGE): ml, ("fl", 1): first, ("fl", 2): second}, rounds={1: 5, 2: 7}
    )
    assert (facts.counts.ml, facts.counts.fl) == (ml, first + second)
    stage, task = facts.of_ml(), facts.of_task(2)
    assert (stage.t0, stage.rounds, stage.counts.ml, stage.counts.fl) == (3, {}, ml, Counts())
    assert (task.t0, task.rounds, task.counts.ml, task.counts.fl) == (0, {2: 7}, Counts(), second)


def test_published_prices_are_of_the_papers_deployment() -> None:
    pairs = {"robots": {1: 2, 2: 2}, "links": {1: 2, 2: 2}, "rounds": {1: 3, 2: 4}}
    facts = Facts("maml", "maml", t0=10, parts={}, training_robots=3, **pairs)  # type: ignore[arg-type]
    bill = published.price(facts, Energy())
    assert bill is not None
    assert bill.sums_j == pytest.approx(dict.fromkeys(bill.sums_j, bill.total_j), rel=1e-12)
    assert bill.ml.total_j == pytest.approx(3524.0)  # 10 x 352.4 J
    assert bill.fl.total_j == pytest.approx(1724.1)  # 7 x 246.3 J
    others = ({"training_robots": 2}, {"robots": {1: 3, 2: 2}}, {"links": {1: 0, 2: 0}})
    for other in others:
        found = Facts("maml", "maml", t0=10, parts={}, **{"training_robots": 3, **pairs, **other})  # type: ignore[arg-type]
        assert published.price(found, Energy()) is None


def test_no_price_is_made_of_counts_that_are_not_numbers() -> None:
    with pytest.raises(ConfigurationError, match="price list 'literal': the bill of arm fl does not add up"):
        price(literal, Facts("fl", "fl", t0=0, parts={("fl", 1): Counts(uplink_bytes=math.nan)}), Energy())
