"""What the page says."""

from collections.abc import Callable
from pathlib import Path

from jouleswarm.common.disk.lock import Lock
from jouleswarm.page import prices
from jouleswarm.page.model import Shown, priced
from jouleswarm.page.source import Folder
from jouleswarm.page.words import answer_section, arm_cards, events_list, heading
from jouleswarm.report.sliders import SLIDERS
from jouleswarm.runs.events import Event

COMPLETE = {"status": "complete", "counters": ""}


def look(path: Path) -> Shown:
    found = Folder(path).look()
    assert found is not None
    return found


def test_the_answer_of_a_run_that_is_over_comes_first_and_follows_the_prices(write_run: Callable[..., Path]) -> None:
    shown = look(write_run(COMPLETE))
    own = shown.scenario.energy
    # the made-up FL, no transfer has not learned task 2
    assert "<b>No verdict: FL, no transfer did not learn all tasks" in answer_section(shown, own)
    assert "At these prices" not in answer_section(shown, own)
    positions = {each.key: float(each.key == "p0_w") for each in SLIDERS}
    # the data center's 2364.72 J become ten times as many: 2364.72 + 823.2 and 23647.2 + 823.2
    assert "At these prices: MAML 3.188 to 24.47 kJ" in answer_section(
        shown, prices.repriced(shown.scenario, positions)
    )


def test_there_is_no_verdict_of_a_run_that_goes_on(write_run: Callable[..., Path]) -> None:
    path = write_run(None)
    with Lock(path, "a run"):
        shown = look(path)
    assert answer_section(shown, shown.scenario.energy) == ""
    assert "bytes by the closed form of its rounds" in heading("run", shown)
    told = arm_cards([priced(arm, shown.prices, shown.scenario.energy) for arm in shown.arms], shown.is_over)
    assert "3 rounds of meta-learning; 10 rounds of 2 tasks; 2 of 2 learned" in told
    assert "30 rounds of 2 tasks; 1 of 2 learned" in told


def test_what_others_have_named_is_text() -> None:
    assert "&lt;script&gt;" in events_list([Event(time_s=0.0, text="<script>")])
    assert "<h1>a&lt;b</h1>" in heading("a<b", None)
