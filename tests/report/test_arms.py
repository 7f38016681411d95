"""What arms are called and how they are told apart by eye."""

from itertools import combinations

import numpy as np
import numpy.typing as npt
import pytest

from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.methods.shipped import all_shipped
from jouleswarm.report.arms import colours, labels


def scenario(methods: list[str], **meta: object) -> Scenario:
    meta = {"t0": 240, "training_tasks": [1], **meta}
    tasks = [{"id": 1, "map": "E*\n.X"}]
    return scenario_from(
        {"name": "x", "world": {"rows": 2, "cols": 2}, "tasks": tasks, "methods": methods, "meta": meta}, "x"
    )


def brightness(colour: str) -> int:
    return sum(int(colour[at : at + 2], 16) for at in (1, 3, 5))


def test_every_method_has_a_label_and_a_colour_of_its_own() -> None:
    shipped = all_shipped()
    assert [method.name for method in shipped.values()] == list(shipped)
    assert len({method.label for method in shipped.values()}) == len(shipped) == 9
    assert len({method.colour for method in shipped.values()}) == 9


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
    assert found["maml"] == "#E69F00"
    assert brightness(found["maml-t42"]) > brightness(found["maml-t66"]) > brightness(found["maml"])
    # 40% of #E69F00 on white: 255 - 0.4 x (255 - 230) = 245, 255 - 0.4 x 96 = 216.6, 255 - 0.4 x 255 = 153
    assert found["maml-t42"] == "#f5d999"


def test_no_two_arms_of_a_large_run_look_alike() -> None:
    found = colours(scenario(list(all_shipped()), adapt_from=[42, 66, 90, 132, 210]))
    assert len(found) == 9 + 5 * 5
    assert all(a != b for a, b in combinations(found.values(), 2))


# Machado, Oliveira and Fernandes (2009), severity 1.0, on linear RGB
SEEN_BY = {
    "all cones": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
XYZ_OVER_WHITE = np.array([[0.4339, 0.3762, 0.1899], [0.2126, 0.7152, 0.0722], [0.0177, 0.1095, 0.8728]])


def cielab(colour: str, seen: list[list[float]]) -> npt.NDArray[np.float64]:
    srgb = np.array([int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)])
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    x, y, z = np.cbrt(XYZ_OVER_WHITE @ np.clip(np.array(seen) @ linear, 0.01, 1))  # none is as dark as L* < 8
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("reader", SEEN_BY)
def test_methods_are_told_apart_by_colour_blind_readers(reader: str) -> None:
    seen = [cielab(colour, SEEN_BY[reader]) for colour in (method.colour for method in all_shipped().values())]
    # a difference of about 2 can just be noticed
    assert min(float(np.linalg.norm(a - b)) for a, b in combinations(seen, 2)) > 14
