"""The broker's log: no client makes its lines long, and who does not read it keeps nobody waiting."""

from __future__ import annotations

import logging
import os
import subprocess
import threading

from jouleswarm.broker.logs import background_log

DEADLINE_S = 20.0
LONG = "/" * 65_535
TAG = "\U000e0001" * 16_383  # of which repr() makes ten characters each


def text(value: str) -> bytes:
    return len(value.encode()).to_bytes(2, "big") + value.encode()


def test_a_log_that_nobody_reads_keeps_nobody_waiting(start_broker, raw) -> None:
    broker = start_broker(stderr=subprocess.PIPE)  # a pipe holds 65,536 bytes; this test reads it last
    connect = text("MQTT") + bytes([4, 2, 0, 0]) + text("c")
    refused = (
        (0x10, text("a" * 65_535) + bytes([4, 2, 0, 0]) + text("c")),
        (0x10, text(TAG) + bytes([4, 2, 0, 0]) + text("c")),
        (0x10, text("MQTT") + bytes([4, 6, 0, 0]) + text("c") + text(LONG) + text("")),
        (0x32, text(LONG) + b"\x00\x13message"),
        (0x32, text("a+" + TAG[:16_000]) + b"\x00\x13message"),
    )
    for _ in range(40):
        for first, body in refused:
            client = raw(broker)
            if first != 0x10:
                client.send(0x10, connect)
                assert client.read()[0] == 0x20
            client.send(first, body)
            assert client.is_closed_by_broker()
    other = raw(broker)
    other.connect("other")
    other.ping()
    broker.process.stdin.close()
    assert broker.process.wait() == 0
    lines = broker.process.stderr.read().splitlines()
    assert len(lines) > 100
    assert max(map(len, lines)) < 600


def test_lines_that_nobody_reads_are_lost_and_counted(monkeypatch) -> None:
    read, write = os.pipe()
    told: list[str] = []
    with open(write, "w", encoding="utf-8") as full, open(read, encoding="utf-8") as pipe:
        reader = threading.Thread(target=lambda: told.extend(pipe), daemon=True)
        monkeypatch.setattr("sys.stderr", full)
        with background_log(logging.WARNING):
            for number in range(3000):  # the pipe holds some 130 of them, and 1000 wait
                logging.getLogger("broker").warning("%s", f"{number:05d}" * 99)
            reader.start()
        full.close()
        reader.join(DEADLINE_S)
    lost = [int(line.split("broker: ")[1].split()[0]) for line in told if "lines were lost: nobody has read" in line]
    assert told[0].endswith("00000" * 99 + "\n")
    assert sum(lost) > 1500
    assert len(told) - len(lost) + sum(lost) == 3000
