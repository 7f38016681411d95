"""The broker's refusals in the terminal: each once, as soon as they are in its log."""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.fleet.broker_log import MOST_LINES, BrokerLog

TOO_LARGE = "connection from 127.0.0.1:{port} closed: packet of 8021504 bytes, the limit here is 1048576"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "broker.log"


def add(path: Path, text: str) -> None:
    with path.open("a", encoding="utf-8") as file:
        file.write(text)


def test_a_refusal_is_shown_once_however_often_its_client_tries_again(path: Path) -> None:
    told: list[str] = []
    log = BrokerLog(path, told.append)
    log.show()  # no broker yet
    for port in (41001, 41002, 41003):
        add(path, f"12:00:01 broker: {TOO_LARGE.format(port=port)}\n")
        log.show()
    add(path, "12:00:02 broker: client agent-1.0a1b2c3d may not publish on a/b: no right for it in the rights file\n")
    add(path, "12:00:03 broker: client agent-1.ffffffff may not publish on a/b: no right for it in the rights file\n")
    add(path, "12:00:04 broker: client agent-1.ffffffff left: DISCONNECT\n")
    log.show()
    assert told == [
        f"broker: {TOO_LARGE.format(port=41001)}",
        "broker: client agent-1.0a1b2c3d may not publish on a/b: no right for it in the rights file",
    ]


def test_a_line_is_shown_when_it_is_whole_and_those_of_an_earlier_run_are_not(path: Path) -> None:
    told: list[str] = []
    add(path, "12:00:00 broker: connection refused: 1000 are open, the limit\n")
    log = BrokerLog(path, told.append)
    add(path, "12:00:01 broker: client agent-1.0a1b2c3d drop")
    log.show()
    assert told == []
    add(path, "ped: it read nothing for 60 s\n")
    log.show()
    assert told == ["broker: client agent-1.0a1b2c3d dropped: it read nothing for 60 s"]


def test_of_very_many_refusals_the_first_ones_are_shown_and_where_the_others_are(path: Path) -> None:
    told: list[str] = []
    log = BrokerLog(path, told.append)
    for size in range(100):
        add(path, f"12:00:00 broker: connection from 10.0.0.1:5 closed: packet of {size} bytes, the limit here is 1\n")
        log.show()
    assert len(told) == MOST_LINES + 1
    assert told[-1] == f"the broker refuses more than is shown here: see {path}"
