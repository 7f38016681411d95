"""The metering proxy as typed, before Mosquitto, with Mosquitto's own clients."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jouleswarm import Meter
from jouleswarm.common.bus.address import parse_url
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.meter.tally import Tally
from jouleswarm.metering.proxy import Proxy
from tests.integration.conftest import wait_until

LINKS = '"fed/+round/+client/up" = { link = "uplink" }\n"fed/+round/model" = { link = "downlink" }\n'
NAMES = ("bytes/received", "bytes/sent", "publish/bytes/received", "publish/bytes/sent")
TOLD_EVERY_S = 1.0


async def ran(*arguments: str) -> str:
    """One of Mosquitto's clients, to its end."""
    process = await asyncio.create_subprocess_exec(*arguments, stdout=subprocess.PIPE)
    told, _ = await asyncio.wait_for(process.communicate(), 30)
    return told.decode()


def totals(tally: Tally) -> list[int]:
    """As NAMES are: all bytes in and out, payload bytes in and out."""
    held = [(what.split(), counts) for (_, _, what), counts in tally.counts().items()]
    whole = [sum(n[2] for (way, kind), n in held if way == each and kind != "repeat") for each in ("in", "out")]
    return whole + [sum(n[1] for (way, kind), n in held if (way, kind) == (each, "publish")) for each in ("in", "out")]


@pytest.mark.external
@pytest.mark.parametrize("version", ["mqttv311", "mqttv5"])
def test_sums_are_mosquittos_own_to_the_byte(
    mosquitto_with: Callable[[str], str], tmp_path: Path, version: str
) -> None:
    url = mosquitto_with("allow_anonymous true\nsys_interval 1\n")

    async def body() -> tuple[list[int], list[int]]:
        tally = Tally()
        async with Proxy(parse_url(url), tally).listening("127.0.0.1", 0) as port:
            common = ("-p", str(port), "-V", version)
            hears = asyncio.create_task(ran("mosquitto_sub", *common, "-i", "s", "-t", "fed/#", "-q", "1", "-C", "9"))
            while tally.counts().get(("s", "", "out control"), (0,))[0] < 2:  # CONNACK and SUBACK
                await asyncio.sleep(0.01)
            for qos, size in ((0, 3), (1, 200_000), (2, 5_565_072)):
                (payload := tmp_path / "payload").write_bytes(bytes(size))
                for number in range(3):
                    to = ("-i", f"c{number}", "-t", f"fed/1/c{number}/up", "-q", str(qos), "-f", str(payload))
                    await ran("mosquitto_pub", *common, *to)
            await hears
            return await compared(tally, common)

    async def compared(tally: Tally, common: tuple[str, ...]) -> tuple[list[int], list[int]]:
        """What Mosquitto tells, once it has told of all that was before who asks; who asks is counted as all are."""
        asked = [part for name in NAMES for part in ("-t", f"$SYS/broker/{name}")]
        for _ in range(10):
            await asyncio.sleep(1.5 * TOLD_EVERY_S)  # nothing passes, and Mosquitto tells
            ours = totals(tally)
            lines = (await ran("mosquitto_sub", *common, *asked, "-C", "4", "-v")).splitlines()
            told = dict(line.removeprefix("$SYS/broker/").split() for line in lines)
            theirs = [int(told.get(name, -1)) for name in NAMES]
            if ours == theirs:
                break
        return ours, theirs

    ours, theirs = asyncio.run(body())
    assert ours == theirs
    assert ours[2] > 3 * 5_565_072


def test_a_meter_as_typed_leaves_a_run_directory_that_bill_prices(broker: str, start: Any, tmp_path: Path) -> None:
    (tmp_path / "links.toml").write_text(LINKS)
    meter = start.jouleswarm(
        "meter", "proxy", "--to", broker, "--listen", "127.0.0.1:0", "--links", str(tmp_path / "links.toml"),
        "--out", str(tmp_path), "--run-id", "metered", "--facts", broker, PYTHONUNBUFFERED="1",
    )  # fmt: skip
    wait_until(lambda: "listening on" in meter.printed, "listening")
    port = meter.printed.split("listening on 127.0.0.1:")[1].split()[0]
    bus = MqttBus.connect(f"mqtt://127.0.0.1:{port}", "c1")
    for _ in range(5):
        bus.publish("fed/1/c1/up", bytes(1000))
    bus.flush()
    bus.close()
    loop = Meter("c1", file=tmp_path / "counts.csv", broker=f"mqtt://127.0.0.1:{port}")
    loop.gradients(20)
    loop.close()
    assert not (tmp_path / "counts.csv").exists()
    wait_until(lambda: (tmp_path / "metered" / "facts.jsonl").exists(), "facts")
    meter.process.send_signal(signal.SIGINT)
    assert meter.ends() == 0
    assert "fed/+round/model (downlink), line 2: matched nothing (0 messages)" in " ".join(meter.printed.split())
    rows = [json.loads(line) for line in (tmp_path / "metered" / "meter.jsonl").read_text().splitlines()]
    (row,) = [row for row in rows if row["topic"] == "fed/1/c1/up"]
    assert (row["kind"], row["labels"], row["link"]) == ("publish", {"round": "1", "client": "c1"}, "uplink")
    # 1 + 2 for the length, 2 + 11 for the topic, 2 for the identifier
    assert (row["messages"], row["payload_bytes"], row["packet_bytes"]) == (5, 5000, 5 * 1018)
    bill = start.jouleswarm("bill", str(tmp_path / "metered"), "--json")
    assert bill.ends() == 0
    joules = json.loads(bill.printed)["arms"]["experiment"]["energy_j"]["literal"]["total"]
    assert joules == pytest.approx(8 * 5000 / 200e3 + 20 * 5.1 * 0.4)  # Table I: 200 kb/J; 5.1 W for 0.4 s a gradient
