"""What `validate` says of the experience that robots will collect."""

from __future__ import annotations

import pytest

from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.report.foretold import experience_line

RULE = ("learning.collect=guide", "learning.epsilon=0.2", "learning.starts=anywhere")
GUIDED = "Experience: robots follow the environment's guide, 0.2 of their actions random, from anywhere"
OWN = "Experience: robots follow their own policy, 0.2 of their actions random, from anywhere"


NONE = "learning.collect is guide, and this environment has none"
SENT = "; those whose experience trains the data center follow"


@pytest.mark.parametrize(
    ("settings", "has_guide", "expected"),
    [
        ((), True, GUIDED),
        (("meta.epsilon=0.6",), True, f"{GUIDED}{SENT} the guide, 0.6, anywhere"),
        (("methods=['fl']", "meta.epsilon=0.6"), True, GUIDED),
        (("methods=['fl']", "learning.collect=own"), True, OWN),
        (("learning.collect=own",), True, f"{OWN}{SENT} the guide, 0.2, anywhere"),
        ((), False, f"{OWN} ({NONE}){SENT} nobody, 1, anywhere"),
    ],
)
def test_the_rule_is_said_as_it_comes_out(settings: tuple[str, ...], has_guide: bool, expected: str) -> None:
    assert experience_line(load_scenario("quick", [*RULE, *settings]), has_guide=has_guide) == expected + "."
