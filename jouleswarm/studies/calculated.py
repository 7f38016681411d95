"""The paper's Fig. 4 out of anybody's own counts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from jouleswarm.common.errors import ConfigurationError, usable
from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.facts import Counts, Facts
from jouleswarm.report.figures import save_figure
from jouleswarm.studies.arms import PLAIN
from jouleswarm.studies.facts import META_STAGE, Fact
from jouleswarm.studies.paper_figures import figure_4a, figure_4b


def draw_calculated(arms: Mapping[str, Facts], energy: Energy, folder: Path) -> list[Path]:
    """Figs. 4a and 4b, at the paper's two pairs of efficiencies; returns the files.

    Raises:
        ConfigurationError: not one arm without a stage, and others with different t0.
    """
    t0s = [facts.t0 for facts in arms.values()]
    if 0 not in t0s or len(set(t0s)) < max(2, len(t0s)):
        raise ConfigurationError(
            f"--figures: the arms have t0 {', '.join(f'{t0:g}' for t0 in t0s)}, expected one without and others with "
            "different ones: Fig. 4 is over t0"
        )
    facts = [fact for each in arms.values() for fact in _stages(each)]
    drawn = {"fig4a": lambda: figure_4a(facts, energy), "fig4b": lambda: figure_4b(facts)}
    with usable("--figures", folder):
        return [path for name, draw in drawn.items() for path in save_figure(folder, name, draw)]


def _stages(facts: Facts) -> Iterator[Fact]:
    """One run of an arm, which rounds are means of several allow: they are no whole numbers."""
    if facts.t0:
        yield _fact(facts, META_STAGE, facts.t0, sum(facts.robots.values()), 0, facts.counts.ml)
    for task, rounds in facts.rounds.items():
        counts = facts.parts.get(("fl", task), Counts())
        yield _fact(facts, task, rounds, facts.robots[task], facts.links[task], counts)


def _fact(facts: Facts, task: int, rounds: float, robots: int, links: int, counts: Counts) -> Fact:
    held: dict[str, Any] = {"variant": "", "seed": 0, "learned": True, "reward": None, "rmse_m": None, "seconds": 0.0}
    held |= {"arm": facts.arm if facts.t0 else PLAIN, "method": facts.method, "t0": facts.t0, "task": task}
    held |= dict.fromkeys(("rounds", "rounds_first", "rounds_w3"), rounds) | {"robots": robots, "links": links}
    return Fact.model_construct(None, **held, **asdict(counts))
