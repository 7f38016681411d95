"""The live view of a run: what it does now, for how long still, where every cluster stands, and the joules so far."""

from __future__ import annotations

import time

from rich import live
from rich.console import Console, RenderableType

from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.energy.bill import Bill
from jouleswarm.energy.literal import literal
from jouleswarm.energy.prices import own_lists, price_lists
from jouleswarm.report.format import joules_text
from jouleswarm.report.pace import Left, Mark, Pace, arm_left_s, left_text, most_left_s, stage_left_s
from jouleswarm.report.sections import Standing, screen
from jouleswarm.report.standing import (
    Live,
    bill_so_far,
    clusters,
    is_over,
    pays_for_stage,
    phase,
    stage_round,
    waits,
)

_LINE_EVERY_S = 10.0
_SCREEN_EVERY_S = 0.25
_WAITS_IN_LINE = 1


class View:
    """Context manager; call `update` now and then. Where there is no terminal it prints a line every few seconds."""

    def __init__(self, console: Console, scenario: Scenario, recorder: Live) -> None:
        self._console, self._scenario, self._recorder = console, scenario, recorder
        lists = price_lists(scenario)
        self._main = literal if literal in lists else next(iter(own_lists(lists)), literal)
        self._others = [each for each in own_lists(lists) if each is not self._main]
        self._since = "so far" if not recorder.newest else "since it went on"
        self._pace = Pace()
        self._live = live.Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None
        self._shown_s = float("-inf")

    def __enter__(self) -> View:
        if self._live:
            self._live.start()
        else:
            self._say(legend(self._scenario))
        self.update()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def update(self) -> None:
        """Show the newest state."""
        self._note()
        now_s = time.monotonic()
        if now_s - self._shown_s < (_SCREEN_EVERY_S if self._live else _LINE_EVERY_S):
            return
        self._shown_s = now_s
        if self._live:
            self._live.update(self.render(), refresh=True)
        else:
            self._say(self.line())

    def line(self) -> str:
        """One line for logs."""
        scenario, heard = self._scenario, self._recorder
        parts = [f"{heard.elapsed_s:5.0f} s", phase(scenario, heard)]
        arm = next((arm for arm in scenario.arms if not is_over(scenario, heard, arm.name)), None)
        if arm is not None and (known := clusters(scenario, heard, arm.name)):
            parts.append("R " + " ".join(f"{each.task}:{_short(each.reward, each.learned)}" for each in known))
        if (bill := self._whole(self._bills())) is not None and bill.total_j:
            cause, most = max(bill.both.by_cause.items(), key=lambda each: each[1])
            parts.append(f"{joules_text(bill.total_j)}, {100 * most / bill.total_j:.0f}% {cause.label}")
        if heard.spent.counts:
            parts.append(left_text(*self._left()))
        return " | ".join([*parts, *waits(scenario, heard)[:_WAITS_IN_LINE]])

    def render(self) -> RenderableType:
        """The whole view, as much of it as fits the terminal."""
        bills = self._bills()
        others = {
            each.label: [bill_so_far(self._scenario, self._recorder, arm, each) for arm in self._scenario.arms]
            for each in self._others
        }
        standing = Standing(
            scenario=self._scenario,
            heard=self._recorder,
            left=left_text(*self._left()),
            bills=bills,
            whole=self._whole(bills),
            others={name: self._whole(dict(zip(bills, held, strict=True))) for name, held in others.items()},
            first={key: span.first.reward for key, span in self._pace.spans.items()},
            since=self._since,
        )
        # One line is the cursor's: a live display as high as the terminal would scroll.
        return screen(standing, self._console, self._console.height - 1)

    def _bills(self) -> dict[str, Bill | None]:
        return {arm.name: bill_so_far(self._scenario, self._recorder, arm, self._main) for arm in self._scenario.arms}

    def _whole(self, bills: dict[str, Bill | None]) -> Bill | None:
        """All arms together; a stage that several start from was there once."""
        whole = Bill()
        for arm in self._scenario.arms:
            if (bill := bills[arm.name]) is None:
                return None
            whole += bill if pays_for_stage(self._scenario, arm) else Bill(fl=bill.fl)
        return whole

    def _note(self) -> None:
        heard, scenario = self._recorder, self._scenario
        at_s = heard.elapsed_s
        for method in scenario.meta_methods:
            if round_ := stage_round(heard, method):
                self._pace.note(method, 0, Mark(at_s, round_))
        for arm in scenario.arms:
            for each in clusters(scenario, heard, arm.name):
                mark = Mark(at_s, each.round, each.reward, each.learned is not None)
                self._pace.note(arm.name, each.task, mark)

    def _left(self) -> tuple[Left, str]:
        scenario, spans, limits = self._scenario, self._pace.spans, self._scenario.federation
        arms = [arm for arm in scenario.arms if not is_over(scenario, self._recorder, arm.name)]
        if not arms:
            return Left(None, None), "arm"
        most_s = most_left_s(scenario, arms, spans)
        if arms[0].t0 and stage_round(self._recorder, arms[0].method) < scenario.meta.t0:
            return Left(stage_left_s(spans.get((arms[0].method, 0)), scenario.meta.t0), most_s), "stage"
        here = [span for (arm, task), span in spans.items() if arm == arms[0].name and task]
        here_s = arm_left_s(here, len(scenario.clusters), limits.target_reward, limits.max_rounds)
        return Left(here_s, most_s), "arm"

    def _say(self, line: str) -> None:
        self._console.print(line, highlight=False, markup=False, soft_wrap=True)


def legend(scenario: Scenario) -> str:
    """What a line for logs is made of; told once, before the first."""
    target = scenario.federation.target_reward
    return (
        f"a line every {_LINE_EVERY_S:g} s: seconds | what is done | R of each task, learned from {target:g} on, "
        "+ learned, - not | joules so far, and most of them for what | time left"
    )


def _short(reward: float | None, learned: bool | None) -> str:
    """`23`, `51+`, `-4-`: R, and how it ended."""
    return ("?" if reward is None else f"{reward:.0f}") + {None: "", True: "+", False: "-"}[learned]
