"""The paper's own experiment: rounds and energy against t0, with and without meta-learning, over seeds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from matplotlib.figure import Figure

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import own_lists
from jouleswarm.runs.paper import TABLE_II
from jouleswarm.studies.arms import PLAIN, groups_of, series_of
from jouleswarm.studies.beta import MEASURED, with_beta_1
from jouleswarm.studies.facts import Fact
from jouleswarm.studies.families import findings, findings_csv, findings_markdown
from jouleswarm.studies.jobs import Request, Variant, methods_setting
from jouleswarm.studies.kinds import Kind, Outputs, Plan
from jouleswarm.studies.paper_energy import break_even_csv, energy_csv, energy_markdown, optimum_csv
from jouleswarm.studies.paper_figures import break_even_figure, figure_3, figure_4a, figure_4b
from jouleswarm.studies.paper_rounds import seen_unseen_csv, seen_unseen_markdown, table_2_csv, table_2_markdown
from jouleswarm.studies.prices import PAIRS
from jouleswarm.studies.ratio_figures import methods_figure, ratios_figure
from jouleswarm.studies.ratio_tables import ratios_csv, ratios_markdown
from jouleswarm.studies.ratios import ratio_rows
from jouleswarm.studies.record import Record
from jouleswarm.studies.verdict import answers, verdict_csv, verdict_markdown

_PAPERS, _OTHER = ("maml", "fomaml"), "multitask"
"""Methods of every study, and the one beside them where the scenario names no other."""
*ON_THE_WAY, LAST_T0 = (t0 for t0 in sorted(TABLE_II) if t0 > 0)


def plan(request: Request) -> Plan:
    """One deployment a seed and method: meta-training to the last t0, adapted from every t0 on the way; and without. Of
    further seeds meta-training ends at the t0 asked for.

    Without methods asked for: MAML exact, with beta measured, its first-order approximation, and the scenario's own.

    Raises:
        ConfigurationError: the user's changes leave nothing to compare, or not the t0 asked for.
    """
    own = [each for each in request.meta_methods if each not in _PAPERS] or [_OTHER]
    settings = [
        methods_setting(request.with_plain(*_PAPERS, *own)),
        f"meta.t0={LAST_T0}",
        f"meta.adapt_from={list(ON_THE_WAY)}",
        MEASURED,
    ]
    _check(request.scenario(settings), request.t0)
    jobs = request.jobs_by_method(settings, Variant(""))
    if request.more_seeds:
        if not request.t0:
            raise ConfigurationError("study paper: got --more-seeds without --t0; name the t0 that they are for")
        only = Variant("", (f"meta.t0={request.t0}", "meta.adapt_from=[]"))
        jobs += request.jobs_by_method(settings, only, request.more_seeds)
    return Plan(jobs, settings)


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
    """Table II, energies, break-even and Figs. 3 and 4, what transfer gains and the verdict, all from facts."""
    scenario, energy, training = record.scenario, record.scenario.energy, record.scenario.meta.training_tasks
    window, lists = scenario.federation.reward_window, with_beta_1(record.lists, energy)
    rows, found = ratio_rows(facts, training, window, energy, lists), answers(facts, training, energy, lists)
    made = Outputs(
        csv={
            "table2": table_2_csv(facts, window),
            "seen_unseen": seen_unseen_csv(facts, training, window),
            "energy": energy_csv(facts, energy, lists),
            "optimum": optimum_csv(facts, energy, lists),
            "breakeven": break_even_csv(facts, energy, training, record.lists),
        },
        markdown={
            "table2": table_2_markdown(facts, window),
            "seen_unseen": seen_unseen_markdown(facts, training, window),
            "energy": energy_markdown(facts, energy, lists),
        },
        figures={"methods": partial(methods_figure, facts, scenario, training)},
    )
    if rows:
        made.csv.update(ratios=ratios_csv(rows), verdict=verdict_csv(found, energy))
        made.markdown["ratios"] = ratios_markdown(rows, groups_of(facts, training))
        made.markdown["verdict"] = [verdict_markdown(found, energy)]
        made.figures["ratios"] = partial(ratios_figure, rows, scenario)
    if shown := findings(rows, record.t0):
        made.csv["tests"], made.markdown["tests"] = findings_csv(shown), [findings_markdown(shown)]
    for place, (method, mine) in enumerate(series_of(facts).items()):
        made.figures.update(_figures(mine, record, f"-{method}" if place else ""))
    return made


def _figures(facts: Sequence[Fact], record: Record, name: str) -> dict[str, Callable[[], Figure]]:
    """The paper's, of one method; of the first one, the paper's own where it ran, they have the plain names."""
    energy, training, lists = record.scenario.energy, record.scenario.meta.training_tasks, record.lists
    sl_bit_per_j, t0 = PAIRS[0].sl_bit_per_j, record.t0 or None
    return {
        f"fig3{name}": partial(figure_3, facts, energy, lists),
        f"fig4a{name}": partial(figure_4a, facts, energy, lists),
        f"fig4b{name}": partial(figure_4b, facts),
        **{
            f"breakeven{name}" + ("" if prices is literal else f"-{prices.name}"): partial(
                break_even_figure, facts, energy, training, sl_bit_per_j, t0, prices
            )
            for prices in (literal, *own_lists(lists))
        },
    }


KIND = Kind(
    name="paper",
    seeds=15,
    t0=0,
    plan=plan,
    tables=outputs,
)
