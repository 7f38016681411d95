"""`report.html` in a real browser, from a file: its script prices as Python does, and nothing is wider than a phone."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import price
from jouleswarm.report.html import write_html
from jouleswarm.runs.run import Run, load_run
from jouleswarm.runs.summary import summarise

CHROMIUM = shutil.which("chromium")
FLAGS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
)

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed: apt-get install chromium"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as browsers:
        found = browsers.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield found
        found.close()


@pytest.fixture
def opened(write_run: Callable[..., Path], facts: Any, browser: Browser) -> Iterator[Callable[..., tuple[Run, Page]]]:
    """Opens the page of the made-up run, with fields of its section energy."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})

    def made(**energy: Any) -> tuple[Run, Page]:
        scenario = scenario_from({**facts.scenario.model_dump(mode="json"), "energy": energy}, "made-up")
        run = load_run(write_run(summarise(scenario, facts.rows, facts.meter_rows), energy=energy))
        view = context.new_page()
        view.goto(write_html(run, run.scenario.energy).as_uri())
        return run, view

    yield made
    context.close()


def totals(view: Page) -> dict[str, float]:
    found: dict[str, float] = json.loads(view.locator("#now").get_attribute("data-totals") or "")
    return found


def move(view: Page, key: str, to: float) -> None:
    told = "(input, to) => { input.value = to; input.dispatchEvent(new Event('input')); }"
    view.locator(f'[data-key="{key}"]').evaluate(told, to)


@pytest.mark.parametrize(
    "own",
    [
        {},
        {"sidelink": "via_base_station", "base_station_pue": 1.3, "dl_bit_per_j": 150e3, "beta": 2.5},
        {"motion_j": 3.0, "forward_j": 0.2},
    ],
    ids=["the paper's", "via the base station", "motions"],
)
def test_the_script_prices_as_python_does(opened: Any, own: dict[str, Any]) -> None:
    run, view = opened(**own)
    # positions are powers of ten: 10^0.5 x 200 kb/J to four digits is 632,500 bit/J, and so on
    moved = {"ul_bit_per_j": 0.5, "sl_bit_per_j": -0.5, "p0_w": 0.1, "t0_batch_s": -0.2, "pk_w": 1, "tk_batch_s": -1}
    energy = run.scenario.energy
    for key, at in [("", 0.0), *moved.items()]:
        if key:
            move(view, key, at)
            value = float(f"{getattr(run.scenario.energy, key) * 10**at:.4g}")
            energy = energy.model_copy(update={key: value})
        bills = {arm: price(literal, facts, energy) for arm, facts in run.facts.items()}
        assert totals(view) == pytest.approx({arm: bill.total_j for arm, bill in bills.items() if bill}, rel=1e-12)


def test_carbon_is_told_once_both_sites_have_an_intensity(opened: Any) -> None:
    _, view = opened()
    move(view, "datacenter_g_per_kwh", 360)
    assert "gCO2e" not in view.inner_text("#now")
    move(view, "robots_g_per_kwh", 360)
    # everything at 360 g/kWh is 1e-4 g/J: 3187.92 J and 2452.8 J, to three digits
    assert "0.319 gCO2e" in view.inner_text("#now")
    assert "0.245 gCO2e" in view.inner_text("#now")


def test_arms_and_scales_are_switched_and_bars_tell_their_joules(opened: Any) -> None:
    _, view = opened()
    assert view.locator("#bars rect[data-tip^='MAML']").count() > view.locator("#bars rect[data-tip^='FL']").count() > 0
    view.click('button[data-arm="maml"]')
    assert view.locator("#bars rect[data-tip^='MAML']").count() == 0
    assert view.locator("#rewards polyline").count() == 2  # of both tasks, without transfer
    view.locator("#bars rect[data-tip]").first.hover()
    assert view.inner_text("#said") == "FL, no transfer, computing, robots: 2.448 kJ (100%)"
    view.click("#log")
    assert view.get_attribute("#log", "aria-pressed") == "true"
    assert view.locator("#bars rect[data-tip]").first.get_attribute("width") == "6"


def test_constants_of_single_robots_leave_no_sliders_and_the_bill_as_it_is(opened: Any) -> None:
    run, view = opened(loss=0.1)
    assert view.locator("#prices").is_hidden()
    bills = {arm: price(literal, facts, run.scenario.energy) for arm, facts in run.facts.items()}
    assert totals(view) == pytest.approx({arm: bill.total_j for arm, bill in bills.items() if bill})


def test_on_a_phone_nothing_is_wider_and_the_figure_is_within_two_screens(opened: Any) -> None:
    _, view = opened()
    errors: list[str] = []
    view.on("pageerror", lambda error: errors.append(str(error)))
    view.set_viewport_size({"width": 390, "height": 844})
    view.reload()
    assert view.evaluate("document.documentElement.scrollWidth") == 390
    wide = "[...document.querySelectorAll('.wide')].filter(each => each.scrollWidth > each.clientWidth).length"
    assert view.evaluate(wide) == 0
    assert view.evaluate("document.getElementById('bill').getBoundingClientRect().top") < 844
    assert errors == []
