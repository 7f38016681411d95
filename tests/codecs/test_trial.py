"""A codec of the user's own is tried when the scenario is read: what is wrong with it is one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jouleswarm.codecs.codec import codec_of
from jouleswarm.codecs.floats import FLOAT32, Float16
from jouleswarm.codecs.int8 import Int8
from jouleswarm.codecs.models import builds_on_base
from jouleswarm.codecs.topk import TopK
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario

TOY = Path(__file__).parents[2] / "scenarios" / "toy.toml"
# Weights as they are, by every name that a codec must have.
GOOD = """
import numpy as np

class Mine:
    name, lossless = "mine", False
    def layout(self, shapes, whole):
        return {key: ("F32", shape) for key, shape in shapes.items()}
    def encode(self, weights, base):
        return dict(weights)
    def decode(self, tensors, shapes, base):
        return {key: tensors[key] for key in shapes}
"""


def scenario_with(folder: Path, codec: str, *overrides: str) -> Scenario:
    """The toy scenario beside a file mine.py that holds `codec`."""
    (folder / "mine.py").write_text(codec)
    (folder / "toy.toml").write_text(TOY.read_text())
    return load_scenario(folder / "toy.toml", ["federation.codec='mine:Mine'", *overrides])


def refusal(folder: Path, codec: str, *overrides: str) -> str:
    """What is said of it, after the scenario's name."""
    with pytest.raises(ConfigurationError) as caught:
        scenario_with(folder, codec, *overrides)
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"scenario {folder / 'toy.toml'}: ")


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


SENT, BACK = "return dict(weights)", "return {key: tensors[key] for key in shapes}"
WRONG = {
    "no such name": (changed("class Mine", "class Min"), "{file} has no Mine; did you mean Min?"),
    "not to be imported": ("import nothing_of_this_name", "{file} cannot be imported: ModuleNotFoundError: No module"),
    "no encode": (changed("def encode", "def write"), "has no encode; expected name, lossless, layout, encode, decode"),
    "not a class": ("Mine = 5", "cannot be made: TypeError: 'int' object is not callable"),
    "made with something": (
        changed("    def layout", "    def __init__(self, bits): ...\n    def layout"),
        "cannot be made: TypeError: Mine.__init__() missing 1 required positional argument: 'bits'",
    ),
    "a name of its own": (changed('"mine"', '"topk"'), "its name is 'topk', which is another codec's; expected one of"),
    "a name that headers hold": (changed('"mine"', "'x' * 33"), "its name is 'xxxxxxxxx"),
    "yes or no": (changed("False", "'no'"), "lossless is 'no', expected True or False"),
    "a share": (changed("    def layout", "    share = 2\n    def layout"), "share is 2, expected more than 0"),
    "a share that is a number": (changed("    def layout", "    share = 'all'\n    def layout"), "share is 'all'"),
    "a dtype of the wire": (changed('"F32"', '"float32"'), "layout gives {{'0.bias': ('float32', (3,)), "),
    "a size that is known": (changed("shape) for", "(-1,)) for"), "layout gives {{'0.bias': ('F32', (-1,)), "),
    "no layout": (changed('{key: ("F32", shape) for key, shape in shapes.items()}', "[*shapes]"), "layout gives ["),
    "encode raises": (
        changed(SENT, "return {key: value + base[key] for key, value in weights.items()}"),
        "encode raises TypeError: 'NoneType' object is not subscriptable (mine.py, line 9)",
    ),
    "changed in place": (
        changed(SENT, "weights['0.bias'] *= 2; return weights"),
        "encode raises ValueError: output array is read-only (mine.py, line 9)",
    ),
    "no arrays": (changed(SENT, "return [*weights]"), "encode gives list, expected a dict of arrays"),
    "not its layout": (
        changed(SENT, "return {key: value.astype(np.float16) for key, value in weights.items()}"),
        "encode does not keep to its layout: 0.weight is F16 (3, 2, 2, 2), expected F32 (3, 2, 2, 2)",
    ),
    "a tensor too few": (
        changed(SENT, "return {key: weights[key] for key in list(weights)[1:]}"),
        "encode does not keep to its layout: 0.weight is not there, expected F32 (3, 2, 2, 2)",
    ),
    "decode raises": (changed(BACK, "return tensors['all']"), "decode raises KeyError: 'all' (mine.py, line 11)"),
    "names do not come back": (changed(BACK, "return {'w': tensors['0.bias']}"), "decode gives ['w'], expected"),
    "shape does not come back": (
        changed(BACK, "return {key: tensors[key].ravel() for key in shapes}"),
        "decode gives 0.weight as float32 (24,), expected float32 (3, 2, 2, 2)",
    ),
    "another dtype comes back": (
        changed(BACK, "return {key: tensors[key] * np.float64(1) for key in shapes}"),
        "decode gives 0.weight as float64 (3, 2, 2, 2), expected float32 (3, 2, 2, 2)",
    ),
    "not finite": (
        changed(BACK, "return {key: tensors[key] / np.float32(0) for key in shapes}"),
        "decode gives 0.weight a weight of size inf, expected at most 20000",
    ),
    "nothing comes back": (
        changed(BACK, "return {key: np.zeros(shape, np.float32) for key, shape in shapes.items()}"),
        "it brings nothing back: after a message receivers are no nearer to the weights",
    ),
    "not lossless": (
        changed("False", "True").replace(BACK, "return {key: np.round(tensors[key], 3) for key in shapes}"),
        "it is lossless, and weights came back with other bits",
    ),
    "by chance": (
        changed(SENT, "noise = np.float32(np.random.rand() / 9); return {k: w + noise for k, w in weights.items()}"),
        "the same weights and base gave two results; expected the same to the bit",
    ),
    "refused by itself": (
        GOOD + "    def check(self, tensors, shapes):\n        raise ValueError('never right')\n",
        "check raises ValueError: never right (mine.py, line 13)",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_with_a_codec_is_one_line(tmp_path: Path, case: str) -> None:
    codec, reason = WRONG[case]
    assert refusal(tmp_path, codec).startswith(f"codec 'mine:Mine': {reason.format(file=tmp_path / 'mine.py')}")


def test_a_message_with_nothing_to_tell_is_tried_too(tmp_path: Path) -> None:
    # Differences by their largest: three models are brought back, and of what receivers hold already comes 0 / 0.
    sent = "d = {k: w - base[k] for k, w in weights.items()} if base else weights"
    steps = "return {k: v / abs(v).max() for k, v in d.items()}"
    relative = changed(SENT, f"{sent}; {steps}").replace(
        BACK, "return {k: t if base is None else base[k] + t for k, t in tensors.items()}"
    )
    assert "0.weight is not finite" in refusal(tmp_path, relative)
    assert scenario_with(tmp_path, relative.replace("abs(v).max()", "max(abs(v).max(), np.float32(1e-9))"))


def test_a_codec_that_keeps_what_it_promises_is_opened_whatever_it_calls_what_it_gets(tmp_path: Path) -> None:
    codec = codec_of(scenario_with(tmp_path, changed("whole", "first").replace("shapes", "sizes")))
    weights = {"w": np.array([1.5, -2.0], np.float32)}
    assert codec.decode(codec.encode(weights, None), {"w": (2,)}, None)["w"].tolist() == [1.5, -2.0]


def test_a_class_method_makes_it_from_the_scenarios_settings(tmp_path: Path) -> None:
    made = "    @classmethod\n    def from_scenario(cls, scenario):\n        made = cls()\n        made.seen = "
    scenario = scenario_with(tmp_path, f"{GOOD}{made}scenario.federation.max_rounds\n        return made\n")
    assert codec_of(scenario).seen == 40  # type: ignore[attr-defined]


def test_an_unknown_word_is_told_with_the_nearest(tmp_path: Path) -> None:
    line = refusal(tmp_path, GOOD, "federation.codec=topq")
    assert (
        line
        == "codec 'topq': expected float16, float32, int8, png, raw, resized, topk or module:name; did you mean topk?"
    )


def test_who_goes_on_without_the_missing_needs_whole_messages(tmp_path: Path) -> None:
    proceed = ("federation.on_missing=proceed", "methods=['fl']")
    assert scenario_with(tmp_path, GOOD, *proceed).federation.codec == "mine:Mine"
    differences = changed(SENT, "return {k: w if base is None else w - base[k] for k, w in weights.items()}").replace(
        BACK, "return {k: t if base is None else base[k] + t for k, t in tensors.items()}"
    )
    assert scenario_with(tmp_path, differences).federation.on_missing == "wait"
    told = 'federation.on_missing = "proceed" with codec {}: expected a codec whose messages are whole, for who comes '
    assert refusal(tmp_path, differences, *proceed).startswith(told.format("mine:Mine"))
    assert refusal(tmp_path, GOOD, *proceed, "federation.codec=topk").startswith(told.format("topk"))


def test_whether_messages_build_on_those_before_is_found_out() -> None:
    assert [builds_on_base(codec) for codec in (FLOAT32, Float16(), Int8(), TopK(0.1), TopK(1.0))] == [
        False, False, False, True, True,
    ]  # fmt: skip
