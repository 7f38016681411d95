"""What arms are called and how they are told apart by eye."""

from itertools import combinations

from common.methods import METHODS
from common.scenario import Scenario, scenario_from
from fleet.arms import METHOD_COLOURS, METHOD_LABELS, colours, labels


def scenario(methods: list[str], **meta: object) -> Scenario:
    meta = {"t0": 240, "training_tasks": [1], **meta}
    tasks = [{"id": 1, "map": "E*\n.X"}]
    return scenario_from(
        {"name": "x", "world": {"rows": 2, "cols": 2}, "tasks": tasks, "methods": methods, "meta": meta}, "x"
    )


def brightness(colour: str) -> int:
    return sum(int(colour[at : at + 2], 16) for at in (1, 3, 5))


def test_every_method_has_a_label_and_a_colour_of_its_own() -> None:
    assert set(METHOD_LABELS) == set(METHOD_COLOURS) == set(METHODS)
    assert len(set(METHOD_LABELS.values())) == len(set(METHOD_COLOURS.values())) == 9


def test_labels_say_from_which_meta_model_an_arm_starts() -> None:
    found = labels(scenario(["maml", "fl", "fedavg"], adapt_from=[42, 66]))
    assert found == {
        "maml-t42": "MAML, t0 = 42",
        "maml-t66": "MAML, t0 = 66",
        "maml": "MAML, t0 = 240",
        "fl": "FL, no transfer",
        "fedavg": "FedAvg by server",
    }


def test_a_meta_model_on_the_way_is_paler_the_earlier_it_is() -> None:
    found = colours(scenario(["maml", "fl"], adapt_from=[42, 66]))
    assert found["maml"] == METHOD_COLOURS["maml"]
    assert brightness(found["maml-t42"]) > brightness(found["maml-t66"]) > brightness(found["maml"])
    # 40% of #E69F00 on white: 255 - 0.4 x (255 - 230) = 245, 255 - 0.4 x 96 = 216.6, 255 - 0.4 x 255 = 153
    assert found["maml-t42"] == "#f5d999"


def test_no_two_arms_of_a_large_run_look_alike() -> None:
    found = colours(scenario(list(METHODS), adapt_from=[42, 66, 90, 132, 210]))
    assert len(found) == 9 + 5 * 5
    assert all(a != b for a, b in combinations(found.values(), 2))
