"""What a user's method must be: each thing that it is not is one line, when the scenario is read."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.methods.contract import read_only, unfit
from jouleswarm.methods.shipped import all_shipped, shipped
from jouleswarm.methods.trial import try_learning

ROOT = Path(__file__).parents[2]
TOY = (ROOT / "scenarios" / "toy.toml").read_text()

METHODS = """
import numpy as np
from jouleswarm import Method

class Nameless(Method):
    pass

class Federated(Method):
    name = "fl"

class OnTheWay(Method):
    name = "mine-t42"

class Level(Method):
    name = "a/b"

class Coloured(Method):
    name, colour = "coloured", "red"

class Alone(Method):
    name, partners = "alone", "itself"

class Sender(Method):
    name, sends = "sender", "experience"

class Server(Method):
    name, sends, partners = "server", "experience", "datacenter"

class Needy(Method):
    name = "needy"
    def __init__(self, more):
        pass

class Shape(Method):
    name = "shape"
    def mix(self, own, theirs, step):
        return {key: value.ravel() for key, value in own.items()}

class Double(Method):
    name = "double"
    def mix(self, own, theirs, step):
        return {key: value.astype(np.float64) for key, value in own.items()}

class Infinite(Method):
    name = "infinite"
    def mix(self, own, theirs, step):
        return {key: value / np.float32(0) for key, value in own.items()}

class Fewer(Method):
    name = "fewer"
    def mix(self, own, theirs, step):
        return {"0.weight": own["0.weight"]}

class InPlace(Method):
    name = "in-place"
    def mix(self, own, theirs, step):
        for key in own:
            own[key] += 1
        return own

class Dice(Method):
    name = "dice"
    def mix(self, own, theirs, step):
        return {key: value + np.float32(np.random.normal()) for key, value in own.items()}

class One(Method):
    name, partners = "one", "datacenter"
    def serve(self, round_):
        return round_.updates[1].weights

class Same(Method):
    name = "same"

class Also(Method):
    name = "same"

class Vector(Method):
    name = "vector"
    def penalty(self, params, start):
        return (params["0.weight"] - start["0.weight"]) ** 2

class Staged(Method):
    name = "staged"
    def stage(self, scenario):
        return scenario.nothing

class Works(Method):
    name = "works"

function = Works.mix
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    (tmp_path / "own.py").write_text(METHODS)
    (tmp_path / "toy.toml").write_text(TOY)
    return tmp_path / "toy.toml"


def loaded(toy: Path, *methods: str) -> Scenario:
    return load_scenario(toy, [f"methods={list(methods)}"])


NAMED = 'expected letters, digits, _ - and ., such as name = "median", and no ending -t and a number'


@pytest.mark.parametrize(
    ("named", "told"),
    [
        ("Nameless", f"its name is '', {NAMED}"),
        ("OnTheWay", f"its name is 'mine-t42', {NAMED}"),
        ("Level", f"its name is 'a/b', {NAMED}"),
        ("Federated", "its name is fl, which is that of a method that ships here; give it one of its own"),
        ("Coloured", "its label and colour are '' and 'red', expected a text and #RRGGBB"),
        ("Alone", "its partners is 'itself', expected one of neighbours, datacenter, nobody"),
        (
            "Sender",
            'it sends experience, expected partners = "datacenter" and a function serve(round_) that learns from it',
        ),
        (
            "Server",
            'it sends experience, expected partners = "datacenter" and a function serve(round_) that learns from it',
        ),
        (
            "Needy",
            "cannot be made without arguments: TypeError: Needy.__init__() missing 1 required positional argument: "
            "'more'",
        ),
        ("Shape", "mix: 0.weight is float32 [6], expected float32 [3, 2]"),
        ("Double", "mix: 0.weight is float64 [3, 2], expected float32 [3, 2]"),
        ("Infinite", "mix: 0.weight is not finite"),
        ("Fewer", "mix: got 0.weight, expected a dict of 0.weight, 0.bias"),
        ("InPlace", "mix failed when it was tried: ValueError: output array is read-only"),
        ("Dice", "mix: other weights the second time, expected the same of the same models"),
        ("function", "got function <function Method.mix"),
        ("Work", "has no Work; did you mean Works?"),
    ],
)
def test_what_a_method_is_not_is_one_line(toy: Path, named: str, told: str) -> None:
    with np.errstate(divide="ignore", invalid="ignore"), pytest.raises(ConfigurationError) as caught:
        loaded(toy, "fl", f"own:{named}")
    message = str(caught.value)
    assert message.startswith(f"scenario {toy}: method 'own:{named}': ")
    assert told in message
    assert "\n" not in message


def test_what_serve_returns_is_a_model_and_a_number(toy: Path) -> None:
    with pytest.raises(
        ConfigurationError, match=r"serve: got \{[^\n]*, expected weights and the number of batch gradients"
    ):
        loaded(toy, "own:One")


def test_two_methods_of_one_name_are_told_by_what_the_scenario_calls_them(toy: Path) -> None:
    with pytest.raises(ConfigurationError, match="methods own:Same and own:Also are both called same, expected a name"):
        loaded(toy, "own:Same", "own:Also")


@pytest.mark.parametrize(
    ("named", "told"),
    [
        ("Vector", r"method 'vector': penalty: got a tensor of shape \[3, 2\], expected one finite number"),
        ("Staged", "method 'staged': its stage failed when it was tried: AttributeError: .* no attribute 'nothing'"),
    ],
)
def test_penalties_and_stages_are_tried_where_pytorch_is(toy: Path, named: str, told: str) -> None:
    scenario = loaded(toy, f"own:{named}")
    with pytest.raises(ConfigurationError, match=told):
        try_learning(scenario)


@pytest.mark.parametrize(("named", "told"), [("Shape", "mix: 0.weight is float32"), ("Vector", "penalty: got a")])
def test_the_command_ends_with_2_before_anything_is_written(toy: Path, named: str, told: str) -> None:
    command = [sys.executable, "-m", "jouleswarm", "run", str(toy), "--set", f"methods=['own:{named}']"]
    ended = subprocess.run(
        [*command, "--out", str(toy.parent / "runs")], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert told in line
    assert not (toy.parent / "runs").exists()


def test_a_method_that_differs_in_nothing_is_consensus(toy: Path) -> None:
    scenario = loaded(toy, "own:Works")
    assert scenario.arm_names == ("works",)
    assert not scenario.needs_datacenter
    assert scenario.method("works").own_penalty is None
    assert scenario.method("maml").name == "maml"  # one that ships here, though the scenario does not name it


def test_ours_keep_the_contract_and_load_no_pytorch() -> None:
    assert [method.name for method in all_shipped().values()] == list(all_shipped())
    assert shipped("median") is None
    code = (
        "import sys; from jouleswarm.methods.shipped import all_shipped; all_shipped(); print('torch' in sys.modules)"
    )
    asked = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert asked.stdout == "False\n"


def test_weights_that_are_handed_out_cannot_be_written_to() -> None:
    held = {"w": np.zeros(2, np.float32)}
    seen = read_only(held)
    with pytest.raises(ValueError, match="read-only"):
        seen["w"][0] = 1
    held["w"][0] = 1  # the owner's can
    assert seen["w"].tolist() == [1, 0]
    assert unfit(seen, {"w": (2,)}) == ""
    assert unfit(seen, {"w": (3,)}) == "w is float32 [2], expected float32 [3]"
    assert unfit(None, {"w": (2,)}) == "got NoneType, expected a dict of w"
