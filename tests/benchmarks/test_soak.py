"""The soak run's judgement, on samples made up by hand."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.soak import MEGABYTE, Sample, messages_amiss, missing, trend


def samples(*points: tuple[int, float, int]) -> list[Sample]:
    return [Sample(float(rounds), "robot", rounds, int(mb * MEGABYTE), fds) for rounds, mb, fds in points]


def test_growth_is_the_slope_after_the_warm_up() -> None:
    # from round 250 on 2 MB in 750 rounds
    found = trend(samples((1, 10.0, 9), (100, 90.0, 9), (250, 100.0, 9), (625, 101.0, 9), (1000, 102.0, 9)))
    assert round(found.mb_per_1000, 6) == round(2 / 0.75, 6)
    assert (found.rounds, found.fds, found.is_flat) == (1000, (9, 9), False)


def test_a_process_whose_descriptors_grow_is_not_flat() -> None:
    assert trend(samples((250, 100.0, 9), (1000, 100.5, 9))).is_flat
    assert not trend(samples((250, 100.0, 9), (1000, 100.5, 10))).is_flat


def test_a_message_is_missing_unless_it_can_be_the_last_rounds() -> None:
    # 100 messages to 2 neighbours each; the run was ended in the middle of the last round
    assert [missing(100, delivered) for delivered in (200, 199, 198, 197)] == [False, False, False, True]
    assert missing(0, 0)


def run_of(folder: Path, topic: str, **messages: int) -> Path:
    """A run directory in which the broker has counted so many messages on a topic, by direction."""
    rows = [
        {"side": "broker", "link": "sidelink", "topic": topic, "direction": direction, "messages": count}
        for direction, count in messages.items()
    ]
    (folder / "meter.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    (folder / "rounds.jsonl").write_text('{"refused": 0}\n')
    (folder / "logs").mkdir()
    return folder


def test_acknowledgements_are_no_deliveries(tmp_path: Path) -> None:
    assert messages_amiss(run_of(tmp_path, "a/weights", **{"in": 100, "out": 200, "acked": 190})) == []


def test_messages_that_were_not_delivered_are_amiss(tmp_path: Path) -> None:
    (found,) = messages_amiss(run_of(tmp_path, "a/weights", **{"in": 100, "out": 190, "acked": 190}))
    assert found.startswith("messages lost: {'a/weights'")


def test_a_request_to_send_again_is_amiss(tmp_path: Path) -> None:
    assert messages_amiss(run_of(tmp_path, "a/resend", **{"in": 1, "out": 1})) == ["requests to send again"]
