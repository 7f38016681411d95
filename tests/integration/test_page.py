"""The page in a real browser: opened while a toy run goes on, it follows the run to its end without being asked."""

from __future__ import annotations

import json
import re
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import psutil
import pytest
from playwright.sync_api import Page, expect, sync_playwright

from tests.integration.conftest import wait_until
from tests.made_up_meter import MadeUpMeter

CHROMIUM = shutil.which("chromium")
FLAGS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
)
WITHIN_MS = 90_000

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed: apt-get install chromium"),
]


class Seen:
    """A run that was seen from its beginning to its end, and the browser that still has it open."""

    def __init__(self, page: Page, started: Any, path: Path, requests: list[str]) -> None:
        self.page, self.started, self.path, self.requests = page, started, path, requests
        self.summary = json.loads((path / "summary.json").read_text())

    def joules(self, arm: str) -> float:
        return float(self.page.locator(f'[data-arm="{arm}"] [data-joules]').get_attribute("data-joules") or "nan")


@pytest.fixture(scope="module")
def seen(starter: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Seen]:
    out = tmp_path_factory.mktemp("seen")
    with sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_context(viewport={"width": 390, "height": 800}).new_page()
        requests: list[str] = []
        page.on("request", lambda request: requests.append(request.url))
        page.on("websocket", lambda socket: requests.append(socket.url))
        started = starter.jouleswarm("run", "toy", "--page", "--no-figures", "--out", str(out), "--run-id", "seen")
        wait_until(lambda: started.printed.count("\n") > 0, "the page's address")
        address = re.match(r"page: (http://127\.0\.0\.1:\d+/)\n", started.printed)  # what is printed first
        assert address, started.printed
        page.goto(address[1], timeout=WITHIN_MS)
        page.wait_for_selector(".status.complete", timeout=WITHIN_MS)
        yield Seen(page, started, out / "seen", requests)
        browser.close()


def test_the_page_ends_with_the_joules_of_the_summary(seen: Seen) -> None:
    for arm, told in seen.summary["arms"].items():
        assert seen.joules(arm) == told["energy_j"]["literal"]["total"]


def test_a_slider_prices_the_same_facts_again(seen: Seen) -> None:
    thumb = seen.page.locator('[data-key="ul_bit_per_j"] .q-slider__track-container')
    before = {arm: seen.joules(arm) for arm in seen.summary["arms"]}
    thumb.press("ArrowRight")
    seen.page.wait_for_function("document.body.innerText.includes('224.4 kb/J')", timeout=WITHIN_MS)
    for arm, joules in before.items():
        moved = seen.summary["arms"][arm]["bytes"]
        bits = 8 * (moved["uplink"]["payload"] + moved["downlink"]["payload"])  # E_DL is E_UL unless set
        assert seen.joules(arm) == pytest.approx(joules - bits / 200e3 + bits / 224.4e3, rel=1e-12)
    assert "--set energy.ul_bit_per_j=224400" in seen.page.inner_text("code")
    seen.page.get_by_text("the run's own prices").click()
    seen.page.wait_for_function("document.body.innerText.includes('200 kb/J')", timeout=WITHIN_MS)
    assert {arm: seen.joules(arm) for arm in before} == before


def test_nothing_was_asked_of_another_machine(seen: Seen) -> None:
    assert len(seen.requests) > 5
    assert {urlsplit(each).hostname for each in seen.requests if urlsplit(each).scheme != "data"} == {"127.0.0.1"}


def test_a_robot_of_each_arm_and_task_follows_its_learned_path(seen: Seen) -> None:
    seen.page.wait_for_function("document.querySelectorAll('.walker').length == 4", timeout=WITHIN_MS)
    # both tasks were learned in both arms, so each path ends at its map's exit, below or beside the entry
    assert all(task["learned"] for arm in seen.summary["arms"].values() for task in arm["tasks"])
    told = seen.page.locator("svg.map title").all_text_contents()
    assert {text.split(":")[0] for text in told} == {"MAML, t0 = 3", "FL, no transfer"}


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_the_screen(seen: Seen, width: int) -> None:
    seen.page.set_viewport_size({"width": width, "height": 800})
    assert seen.page.evaluate("document.documentElement.scrollWidth") == width


def test_a_meters_directory_is_shown_and_priced_again(seen: Seen, starter: Any, tmp_path: Path) -> None:
    links = '"up" = { link = "uplink" }'
    with MadeUpMeter(tmp_path / "mine", links) as meter:
        meter.pass_by(0, [("<img src=x onerror=alert(1)>", "up", "in", 2000)])
        started = starter.jouleswarm("page", str(tmp_path / "mine"), "--port", "0")
        wait_until(lambda: started.printed.count("\n") > 0, "the page's address")
        page = seen.page.context.new_page()
        page.goto(started.printed.split()[1], timeout=WITHIN_MS)
        total = page.locator("[data-joules]")
        expect(total).to_have_text("0.08 J", timeout=WITHIN_MS)  # 16,000 bits at 200 kb/J
        meter.pass_by(1, [("r2", "up", "in", 3000)])
        expect(total).to_have_text("0.2 J", timeout=WITHIN_MS)
    expect(page.locator(".status")).to_have_text("complete", timeout=WITHIN_MS)
    page.locator('[data-key="ul_bit_per_j"] .q-slider__track-container').press("ArrowRight")
    expect(total).to_have_text("0.1783 J", timeout=WITHIN_MS)  # 40,000 bits at 224.4 kb/J
    assert page.locator("main img").count() == 0
    assert page.evaluate("document.documentElement.scrollWidth") == page.viewport_size["width"]
    page.close()


def test_ctrl_c_ends_the_page_and_leaves_nothing(seen: Seen) -> None:
    family = [process for process in seen.started.family if process.pid != seen.started.process.pid]
    assert family
    wait_until(lambda: "the page stays at http://127.0.0.1" in seen.started.printed, "the run's bill")
    seen.started.process.send_signal(signal.SIGINT)
    assert seen.started.ends() == 0
    assert not any(psutil.pid_exists(process.pid) and process.is_running() for process in family)
