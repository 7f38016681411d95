"""Values beyond any return of the rewards: what they are, and who is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.saved_models import encode_saved_model
from jouleswarm.learning.dqn import ran_away
from jouleswarm.learning.networks import build_qnetwork, shapes_of, use_of
from jouleswarm.report.report import report
from jouleswarm.simulation import run_in_memory
from jouleswarm.studies.catalogue import kind_of
from jouleswarm.studies.record import Record
from tests.studies.made_up import meta_fact, task_fact

LINE = """
name = "line"
environment = "tests.worlds:Known"
methods = ["fl"]
learning = { batches_per_round = 1, motions_per_round = 2, max_episode_steps = 8, init = "start.safetensors" }
federation = { target_reward = 1000, reward_window = 1, max_rounds = 1 }
network = { dense = [4] }
[[tasks]]
id = 1
"""


@pytest.mark.parametrize(
    ("values", "rewards", "discount", "expected"),
    [
        # the limit is 5 / (1 - 0.5) = 10, ten times that 100
        ([90.0, -110.0], [1.0, -5.0], 0.5, None),
        ([90.0, -112.0], [1.0, -5.0], 0.5, 101.0),
        ([21.0], [0.0], 0.5, 21.0),  # a reward of 1 at least: 2, and 20
        ([19.0], [0.0], 0.5, None),
        ([1e9], [1.0], 1.0, None),
        ([], [], 0.5, None),
    ],
)
def test_values_have_run_away_ten_times_beyond_what_rewards_add_up_to(
    values: list[float], rewards: list[float], discount: float, expected: float | None
) -> None:
    assert ran_away(values, rewards, discount) == expected


@pytest.mark.parametrize(("bias", "expected"), [(9000.0, 9000.0), (3.0, None)])
def test_a_robot_that_starts_from_such_a_model_says_so_in_round_0(
    bias: float, expected: float | None, tmp_path: Path
) -> None:
    # Rewards are 2, 4, 6 and 8: the limit is 8 / (1 - 0.99) = 800.
    (tmp_path / "line.toml").write_text(LINE.replace(', init = "start.safetensors"', ""))
    scenario = load_scenario(tmp_path / "line.toml")
    weights = {name: np.zeros(shape, np.float32) for name, shape in shapes_of(build_qnetwork(scenario)).items()}
    list(weights.values())[-1][1] = bias  # Q of the second action, on every observation
    model = encode_saved_model(weights, ModelHeader(task=1, agent=1, round=1), use_of(scenario))
    (tmp_path / "start.safetensors").write_bytes(model)
    (tmp_path / "line.toml").write_text(LINE)
    rows = run_in_memory(load_scenario(tmp_path / "line.toml")).rows
    assert [row.ran_away for row in rows if row.agent == 1 and row.round == 0] == [expected]
    assert ("ran_away" in rows[0].model_dump()) == (expected is not None)


def test_the_report_says_it_before_all_else(write_run: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    path = write_run({"status": "complete"})
    report(path, figures=())
    assert "run away" not in capsys.readouterr().out
    away = {"reward": -9.0, "cluster_reward": -9.0, "seconds": 1.0}
    for agent, round_, value in ((1, 0, 7000.0), (2, 0, 8250.0)):
        row = RoundRow(phase="fl", arm="maml", task=1, agent=agent, round=round_, ran_away=value, **away)
        with (path / "rounds.jsonl").open("a") as file:
            file.write(row.model_dump_json() + "\n")
    report(path, figures=())
    told = " ".join(capsys.readouterr().out.split())
    assert told.startswith("Values have run away: MAML, t0 = ")
    assert "task 1, in rounds 0 to 0, mean |Q| up to 8.2e+03, far beyond any return" in told


def test_a_study_says_below_its_tables_of_which_arms() -> None:
    maml, plain = Arm("maml", "maml", 42), Arm("fl", "fl", 0)
    facts = [task_fact(plain, 1, 9, variant="base"), meta_fact(maml, variant="base")]
    facts += [task_fact(maml, 1, 9, variant="base", ran_away=3), task_fact(maml, 2, 9, variant="base")]
    record = Record(study="regimes", profile="compact", scenario=load_scenario("quick"), seeds=(1,), t0=42)
    note = (
        "Values ran away, beyond any return, in tasks of maml with base in 1 of 2: "
        "their rounds tell of this, and not of the method."
    )
    (table,) = kind_of("regimes").outputs(facts, record).markdown["regimes"]
    assert table.notes[-1] == note
    calm = [fact.model_copy(update={"ran_away": 0}) for fact in facts]
    (table,) = kind_of("regimes").outputs(calm, record).markdown["regimes"]
    assert note not in table.notes
