"""Settings that are a method's own: whose jobs have them, and files that are none."""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.studies.catalogue import kind_of
from jouleswarm.studies.jobs import Request
from jouleswarm.studies.tuned import Tuned, read_tuned

TUNED = Tuned(
    robots=("learning.lr=0.002",),
    methods={"maml": ("meta.heads=shared", "meta.inner_lr=0.01"), "fomaml": ("meta.inner_lr=0.003",)},
)


def test_each_method_is_run_with_its_own_settings_and_the_robots() -> None:
    asked = Request(Path("toy"), ("meta.t0=4", "meta.adapt_from=[2]"), (1,), 0, ("maml", "fomaml"), TUNED)
    found = {}
    for job in kind_of("paper").plan(asked).jobs:
        scenario = job.load()
        (name,) = scenario.method_names
        found[name] = (scenario.learning.lr, scenario.meta.heads, scenario.meta.inner_lr)
    assert found == {
        "maml": (0.002, "shared", 0.01), "fomaml": (0.002, "per_task", 0.003), "fl": (0.002, "per_task", 0.03)
    }  # fmt: skip


def test_a_pair_has_the_settings_of_its_one_method_and_what_the_user_says_comes_after_them() -> None:
    asked = Request(Path("toy"), ("meta.inner_lr=0.02",), (1,), 4, ("maml",), TUNED)
    settings = [job.load() for job in kind_of("regimes").plan(asked).jobs]
    assert {each.method_names for each in settings} == {("maml", "fl")}
    assert {(each.meta.heads, each.meta.inner_lr) for each in settings} == {("shared", 0.02)}
    # The authors' regimes set the robots' learning rate themselves.
    assert {each.learning.lr for each in settings} == {0.002, 2.5e-4}


def test_of_several_methods_in_one_deployment_only_the_robots_settings_hold() -> None:
    assert TUNED.of(["maml", "fomaml", "fl"]) == TUNED.of(["fl"]) == ("learning.lr=0.002",)


def test_a_file_is_read(tmp_path: Path) -> None:
    file = tmp_path / "best.toml"
    file.write_text(
        'robots = ["learning.lr=0.002"]\n[methods]\n'
        'maml = ["meta.heads=shared", "meta.inner_lr=0.01"]\nfomaml = ["meta.inner_lr=0.003"]\n'
    )
    assert read_tuned(file) == TUNED
    assert read_tuned(None) == Tuned()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('robots = "learning.lr=1"', r"robots: .*tuple"),
        ("robot = []", r"robot: Extra"),
        ("robots = [", r"best\.toml: "),
    ],
)
def test_a_file_that_holds_something_else_is_told(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "best.toml").write_text(text)
    with pytest.raises(ConfigurationError, match=told) as error:
        read_tuned(tmp_path / "best.toml")
    assert "expected robots = [" in str(error.value)


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"--tuned .*none\.toml: cannot be read"):
        read_tuned(tmp_path / "none.toml")
