"""A round in one line, on the shell of who started a process by hand."""

from typing import Any

import pytest

from jouleswarm.common.wire.rows import RoundRow
from jouleswarm.common.wire.told_round import round_line
from jouleswarm.common.wire.topics import Link


@pytest.mark.parametrize(
    ("row", "line"),
    [
        (
            {"phase": "fl", "agent": 3, "round": 12, "reward": 23.14, "cluster_reward": 20.44, "gradients": 20},
            "maml, task 2, round 12: own reward 23.1, R of the cluster 20.4, 20 gradients, 1.5 MB received so far",
        ),
        (
            {"phase": "fl", "agent": 3, "round": 13, "cluster_reward": 51.0, "learned": True},
            "maml, task 2, round 13: R of the cluster 51.0, 1.5 MB received so far; learned",
        ),
        (
            {"phase": "maml", "agent": 3, "round": 4},
            "maml, task 2, meta-learning round 4: experience sent up, 1.5 MB received so far",
        ),
        (
            {"phase": "maml", "agent": 0, "round": 4, "gradients": 8},
            "maml, task 2, meta-learning round 4: 8 gradients, 1.5 MB received so far",
        ),
    ],
)
def test_a_round_is_told_in_a_line_with_what_has_come_but_control(row: dict[str, Any], line: str) -> None:
    made = RoundRow.model_validate({"arm": "maml", "task": 2, "seconds": 0.1, **row})
    received = {Link.UPLINK: 0, Link.DOWNLINK: 500_000, Link.SIDELINK: 1_000_000, Link.CONTROL: 77_000_000}
    assert round_line(made, received) == line
