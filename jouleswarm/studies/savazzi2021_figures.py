"""Figures of `studies.savazzi2021`: who wins at which efficiencies, and in which country."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from jouleswarm.common.scenario.energy import Energy
from jouleswarm.energy.crossing import Footprint, cheaper
from jouleswarm.report.arms import INK
from jouleswarm.report.canvas import bars, new_figure
from jouleswarm.report.look import looks_of
from jouleswarm.studies.savazzi2021_cases import CASES, COUNTRIES, METHODS, Case, grams, totals

_LOOKS = dict(zip(METHODS, looks_of(("#0072B2", "#E69F00", "#7F7F7F")), strict=True))
_AXIS = np.geomspace(10e3, 1000e3, 241)
_PRINTED = {"uplink": 50, "sidelink": 200}  # kbit/J: the thresholds of the 2021 paper's abstract
_ABROAD = (("NO", "PL"), ("IT", "IT"), ("PL", "NO"))  # robots, data center


def winners_figure(found: Mapping[str, Case]) -> Figure:
    """Who costs least against E_UL and E_SL, a panel a case; dashed the printed thresholds."""
    figure = new_figure(2.9)
    panels = figure.subplots(1, len(found), sharey=True)
    for axes, (name, case) in zip(panels, found.items(), strict=True):
        held = list(totals(case).values())
        joules = np.array([each.fixed + each.ul_bits / _AXIS + each.sl_bits / _AXIS[:, None] for each in held])
        winner, colours = joules.argmin(axis=0), ListedColormap([look.colour for look in _LOOKS.values()])
        axes.pcolormesh(_AXIS / 1e3, _AXIS / 1e3, winner, cmap=colours, vmin=0, vmax=len(held) - 1, rasterized=True)
        for number, look in enumerate(_LOOKS.values()):
            if look.hatch and (winner == number).any():
                where = axes.contourf(
                    _AXIS / 1e3, _AXIS / 1e3, winner == number, levels=[0.5, 1.5], colors="none", hatches=[look.hatch]
                )
                where.set_edgecolor("white")
        axes.axvline(_PRINTED["uplink"], color=INK, linewidth=0.8, linestyle="--")
        axes.axhline(_PRINTED["sidelink"], color=INK, linewidth=0.8, linestyle="--")
        axes.set_title(CASES[name], fontsize=8)
        _logarithmic(axes)
    panels[0].set_ylabel("$E_{SL}$ (kb/J)")
    figure.legend(handles=_patches(), loc="outside upper center", ncols=len(METHODS))
    return figure


def carbon_figure(case: Case, energy: Energy) -> Figure:
    """Grams where both sites are in one country, and above which E_SL consensus FL emits least, at home and abroad."""
    figure = new_figure(3.0)
    left, right = figure.subplots(1, 2)
    emitted = [totals(case, *grams(country, country)) for country in COUNTRIES]
    for place, (method, look) in enumerate(_LOOKS.items()):
        heights = [each[method].at(energy.ul_bit_per_j, energy.sl_bit_per_j) for each in emitted]
        bars(left, place, len(METHODS), heights, look, texts=[f"{each:.2g}" for each in heights])
    left.set_xticks(range(len(COUNTRIES)), list(COUNTRIES))
    left.set_ylabel("gCO2e, both sites there")
    left.set_title(f"{energy.ul_bit_per_j / 1e3:g}/{energy.sl_bit_per_j / 1e3:g} kb/J", fontsize=8)
    _logarithmic(right)
    right.set_ylim(0.1, _AXIS[-1] / 1e3)
    for (robots, datacenter), style in zip(_ABROAD, ("-", "--", ":"), strict=True):
        held = totals(case, *grams(robots, datacenter))
        label = f"robots {robots}, data center {datacenter}"
        right.plot(
            _AXIS / 1e3, [_needed(held, ul) / 1e3 for ul in _AXIS], style, color=_LOOKS["fl"].colour, label=label
        )
    right.set_ylabel("consensus FL emits least above\n$E_{SL}$ (kb/J)")
    right.legend(fontsize=6.5)
    figure.legend(handles=_patches(), loc="outside upper center", ncols=len(METHODS))
    return figure


def _needed(held: Mapping[str, Footprint], ul: float) -> float:
    """E_SL from which consensus FL is below all others; nan where it never is, 0 where always."""
    found = [cheaper(held["fl"].along_sl(ul), held[method].along_sl(ul)) for method in METHODS if method != "fl"]
    if any(each.where in ("never", "below") for each in found):
        return float("nan")
    return max(each.bit_per_j or 0.0 for each in found)


def _logarithmic(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("$E_{UL}$ (kb/J)")


def _patches() -> list[Patch]:
    return [Patch(**_LOOKS[method].face, label=name) for method, name in METHODS.items()]
