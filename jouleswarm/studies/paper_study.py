"""The paper's own experiment: rounds and energy against t0, with and without meta-learning, over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import own_lists
from jouleswarm.runs.paper import TABLE_II
from jouleswarm.studies.arms import PLAIN
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.jobs import Request, Variant, methods_setting
from jouleswarm.studies.kinds import Kind, Outputs, Plan
from jouleswarm.studies.paper_energy import break_even_csv, energy_csv, energy_markdown, optimum_csv
from jouleswarm.studies.paper_figures import break_even_figure, figure_3, figure_4a, figure_4b
from jouleswarm.studies.paper_rounds import seen_unseen_csv, seen_unseen_markdown, table_2_csv, table_2_markdown
from jouleswarm.studies.prices import PAIRS
from jouleswarm.studies.record import Record

*ON_THE_WAY, LAST_T0 = (t0 for t0 in sorted(TABLE_II) if t0 > 0)


def plan(request: Request) -> Plan:
    """One deployment a seed: meta-training to the last t0, adapted from every t0 on the way, and without.

    Raises:
        ConfigurationError: the user's changes leave nothing to compare, or not the t0 asked for.
    """
    settings = [
        methods_setting([request.meta_method, "fl"]),
        f"meta.t0={LAST_T0}",
        f"meta.adapt_from={list(ON_THE_WAY)}",
    ]
    _check(request.scenario(settings), request.t0)
    return Plan(request.jobs([Variant("")], settings), settings)


def _check(scenario: Scenario, t0: int) -> None:
    """What only figures would notice, before hours are spent."""
    given = [arm.t0 for arm in scenario.arms if arm.t0]
    if not given or PLAIN not in scenario.arm_names:
        raise ConfigurationError(
            f"study paper: got methods {', '.join(scenario.methods)}, expected one with meta-learning, and {PLAIN}"
        )
    if t0 not in (0, *given):
        told = ", ".join(map(str, given))
        raise ConfigurationError(f"study paper: got --t0 {t0}, expected one of the scenario's: {told}")


def outputs(facts: Sequence[Fact], record: Record) -> Outputs:
    """Table II, energies, break-even and Figs. 3 and 4, all from facts."""
    energy, training, lists = record.scenario.energy, record.scenario.meta.training_tasks, record.lists
    window = record.scenario.federation.reward_window
    sl_bit_per_j = PAIRS[0].sl_bit_per_j
    return Outputs(
        csv={
            "table2": table_2_csv(facts, window),
            "seen_unseen": seen_unseen_csv(facts, training, window),
            "energy": energy_csv(facts, energy, lists),
            "optimum": optimum_csv(facts, energy, lists),
            "breakeven": break_even_csv(facts, energy, training, lists),
        },
        markdown={
            "table2": table_2_markdown(facts, window),
            "seen_unseen": seen_unseen_markdown(facts, training, window),
            "energy": energy_markdown(facts, energy, lists),
        },
        figures={
            "fig3": lambda: figure_3(facts, energy, lists),
            "fig4a": lambda: figure_4a(facts, energy, lists),
            "fig4b": lambda: figure_4b(facts),
            **{
                "breakeven" if prices is literal else f"breakeven-{prices.name}": partial(
                    break_even_figure, facts, energy, training, sl_bit_per_j, record.t0 or None, prices
                )
                for prices in (literal, *own_lists(lists))
            },
        },
    )


KIND = Kind(
    name="paper",
    seeds=15,
    t0=0,
    plan=plan,
    tables=outputs,
)
