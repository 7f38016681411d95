"""`jouleswarm meter serve` as typed, with clients that nobody here wrote, and a metering proxy before it."""

from __future__ import annotations

import asyncio
import json
import signal
import socket
import urllib.request
from pathlib import Path
from typing import Any

import aiomqtt
import pytest

from jouleswarm.common.bus.address import parse_url
from jouleswarm.common.meter.tally import Row, Tally, rows_of
from jouleswarm.common.wire.rules import read_rules
from jouleswarm.metering.proxy import Proxy
from tests.integration.conftest import wait_until

LINKS = """\
"fed/+round/+client/up" = { link = "uplink" }
"peers/+sender/#rest" = [{ link = "uplink", receiver = "server*" }, { link = "sidelink" }]
"never/#" = { link = "control" }
"""


async def ran(*arguments: str) -> None:
    """One of Mosquitto's clients, to its end."""
    process = await asyncio.create_subprocess_exec(*arguments, stdout=asyncio.subprocess.DEVNULL)
    assert await asyncio.wait_for(process.wait(), 30) == 0


async def neighbours_exchange(port: int) -> None:
    """robot-1 and robot-2 send 1000 bytes each, QoS 1, which both of them and server-1 get; robot-1 also 5000 up."""

    async def hears(client: aiomqtt.Client) -> None:
        for _ in range(2):
            await asyncio.wait_for(anext(aiter(client.messages)), 20)

    names = "server-1", "robot-1", "robot-2"
    made = [aiomqtt.Client("127.0.0.1", port, identifier=name) for name in names]
    async with made[0], made[1], made[2]:
        for client in made:
            await client.subscribe("peers/#", qos=1)
        for client, name in zip(made[1:], names[1:], strict=True):
            await client.publish(f"peers/{name}/w", bytes(1000), qos=1)
        await asyncio.gather(*map(hears, made))
        await made[1].publish("fed/7/robot-1/up", bytes(5000), qos=2)


async def mosquitto_sends(port: int, folder: Path) -> None:
    (payload := folder / "payload").write_bytes(bytes(5_565_072))
    common = ("-p", str(port), "-V", "mqttv311")
    hears = asyncio.create_task(ran("mosquitto_sub", *common, "-i", "server-2", "-t", "fed/#", "-q", "2", "-C", "1"))
    while not hears.done():
        await ran("mosquitto_pub", *common, "-t", "fed/8/m/up", "-q", "2", "-f", str(payload))  # has no id
    await hears


def counted(rows: list[Row]) -> dict[tuple[str, ...], tuple[Any, ...]]:
    return {
        (row.direction, row.kind, row.client, row.topic): (
            row.link, row.rule, dict(row.labels), row.messages, row.payload_bytes, row.packet_bytes, row.repeats,
        )
        for row in rows
    }  # fmt: skip


def exported(metrics: str) -> float:
    """Bytes of whole packets, of all rules and of none."""
    with urllib.request.urlopen(metrics) as answer:
        lines = answer.read().decode().splitlines()
    return sum(
        float(line.split()[-1]) for line in lines if line.startswith("jouleswarm_broker_rule_packet_bytes_total")
    )


@pytest.mark.external
def test_broker_and_proxy_count_the_same_of_clients_that_nobody_here_wrote(start: Any, tmp_path: Path) -> None:
    (links := tmp_path / "links.toml").write_text(LINKS)
    meter = start.jouleswarm(
        "meter", "serve", "--listen", "127.0.0.1:0", "--links", str(links), "--out", str(tmp_path), "--run-id", "m",
        PYTHONUNBUFFERED="1",
    )  # fmt: skip
    wait_until(lambda: "counts go to" in meter.printed, "listening")
    url, metrics = (meter.printed.split(f"{what} at ")[1].split(";")[0].split(",")[0] for what in ("broker", "metrics"))

    async def body() -> Tally:
        tally = Tally()
        async with Proxy(parse_url(url), tally).listening("127.0.0.1", 0) as port:
            await neighbours_exchange(port)
            await mosquitto_sends(port, tmp_path)
        return tally

    tally = asyncio.run(body())
    passed = sum(counts[2] for (_, _, what), counts in tally.counts().items() if not what.endswith("repeat"))
    wait_until(lambda: exported(metrics) == passed, "all bytes in the metrics")
    links.write_text('"x/+" = 1')
    meter.process.send_signal(signal.SIGHUP)
    wait_until(lambda: "line 1: 'x/+'" in meter.printed and "the rules before stay" in meter.printed, "refused")
    links.write_text(LINKS.replace("round", "turn"))
    meter.process.send_signal(signal.SIGHUP)
    wait_until(lambda: f"4 rules of {links} from now on" in meter.printed, "read anew")
    meter.process.send_signal(signal.SIGINT)
    assert meter.ends() == 0
    assert "never/# (control), line 3: matched nothing (0 messages)" in " ".join(meter.printed.split())
    rows = [Row(**json.loads(line)) for line in (tmp_path / "m" / "meter.jsonl").read_text().splitlines()]
    assert counted(rows) == counted(rows_of(tally.counts(), read_rules(links)))
    # By hand: 1 + 2 for the length, 2 + 15 for the topic, 2 for the identifier; or 2 + 16 for the topic.
    found = counted(rows)
    peers = "peers/+sender/#rest", {"sender": "robot-1", "rest": "w"}, 1, 1000, 1022, 0
    assert found["in", "publish", "robot-1", "peers/robot-1/w"] == ("sidelink", *peers)
    assert found["out", "publish", "robot-2", "peers/robot-1/w"] == ("sidelink", *peers)
    assert found["out", "publish", "server-1", "peers/robot-1/w"] == ("uplink", *peers)
    up = "uplink", "fed/+turn/+client/up", {"turn": "7", "client": "robot-1"}, 1, 5000, 5023, 0
    assert found["in", "publish", "robot-1", "fed/7/robot-1/up"] == up
    assert sum(row.packet_bytes for row in rows) == passed
    assert {each.name for each in (tmp_path / "m").iterdir()} == {
        *("manifest.json", "meter.jsonl", "windows.jsonl", "bill.csv", "summary.json", "report.html", "logs")
    }
    assert "turn" in json.loads((tmp_path / "m" / "manifest.json").read_text())["rules"]


@pytest.mark.parametrize("is_taken", [True, False])
def test_an_address_in_use_or_a_bad_rule_is_one_line_and_exit_code_2(
    start: Any, tmp_path: Path, is_taken: bool
) -> None:
    (links := tmp_path / "links.toml").write_text(LINKS if is_taken else f'{LINKS}"a#" = {{ link = "uplink" }}')
    with socket.create_server(("127.0.0.1", 0)) as taken:
        where = f"127.0.0.1:{taken.getsockname()[1] if is_taken else 0}"
        out = ("--out", str(tmp_path / "out"))
        meter = start.jouleswarm("meter", "serve", "--listen", where, "--links", str(links), *out)
        assert meter.ends() == 2
    told = (
        f"cannot listen on {where} (Address already in use)"
        if is_taken
        else f"{links}, line 4: 'a#' is no topic filter"
    )
    assert meter.printed.startswith(f"jouleswarm meter: {told}")
    assert len(meter.printed.splitlines()) == 1
    assert not (tmp_path / "out").exists()
