"""Whole runs with TLS, users and topic rights: every right that is needed is there, and nothing else changes."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.bus.credentials import credentials_of
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Presence, decode_json
from jouleswarm.methods.shipped import all_shipped

ROOT = Path(__file__).parents[2]
TOY = str(ROOT / "scenarios" / "toy.toml")


@dataclass
class Guarded:
    url: str
    metrics: str

    def event(self, name: str) -> float:
        with urllib.request.urlopen(self.metrics, timeout=20) as answer:
            found = re.search(rf'jouleswarm_broker_events_total{{event="{name}"}} (\S+)', answer.read().decode())
        return float(found.group(1)) if found else 0.0


@pytest.fixture
def guarded(keys: Path) -> Iterator[Guarded]:
    """A broker with the toy scenario's folder of keys."""
    command = [sys.executable, "-m", "jouleswarm.broker", "--port", "0", "--metrics-port", "0", "--exit-with-stdin"]
    with subprocess.Popen(
        [*command, "--keys", str(keys)], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        yield Guarded(**json.loads(process.stdout.readline()))
        process.stdin.close()


def kinds(run: Any) -> set[str]:
    """Last levels of the topics that the broker was sent something on."""
    rows = run.lines("meter.jsonl")
    return {row["topic"].rsplit("/", 1)[1] for row in rows if (row["side"], row["direction"]) == ("broker", "in")}


def unique(figures: list[dict[str, Any]]) -> set[str]:
    return {json.dumps(row) for row in figures}


def test_all_methods_with_requests_to_send_again_need_no_further_right_and_learn_the_same(
    guarded: Guarded, keys: Path, start: Any, read_run: Any, small: tuple[str, ...], methods_run: Any, tmp_path: Path
) -> None:
    overrides = (*small, f"methods={list(all_shipped())}", "meta.adapt_from=[1]", "bus.resend_after_s=0.02")
    run = start.jouleswarm(
        "run", TOY, "--broker", guarded.url, "--keys", str(keys), "--run-id", "guarded", "--out", str(tmp_path),
        "--no-figures", *(part for each in overrides for part in ("--set", each)),
    )  # fmt: skip
    assert run.ends() == 0, run.printed
    done = read_run(tmp_path / "guarded", run.printed)
    assert done.weights == methods_run.weights
    # Training robots that are asked again send their round again, and tell so by the same row again.
    assert unique(done.figures) == unique(methods_run.figures)
    assert {"resend", "collect", "again"} <= kinds(done)
    assert done.summary["metered_by"] == "broker"
    for event in ("refused_not_permitted", "refused_not_authorized", "refused_tls", "refused_malformed"):
        assert guarded.event(event) == 0, event
    sent, received = (
        {(row["topic"], row["client"]): row["packet_bytes"] for row in done.lines("meter.jsonl")
         if (row["side"], row["direction"]) == way} for way in (("client", "out"), ("broker", "in"))
    )  # fmt: skip
    assert sent == received


def test_a_robot_that_comes_late_asks_for_the_meta_model_by_its_right(
    guarded: Guarded, keys: Path, by_hand: Any, small_run: Any
) -> None:
    hand = by_hand(guarded.url, options=("--keys", str(keys)))
    recorder = hand.recorder()
    ears = MqttBus.connect(guarded.url, "datacenter", credentials=credentials_of(keys, "datacenter"))
    ears.subscribe(topics.presence(hand.name, 2, 3), qos=0)  # what it acknowledged would be held against the other one
    others = [hand.data_center(), hand.robot(1), hand.robot(2), hand.robot(3)]
    while decode_json(ears.receive(60).payload, Presence).stage < 1:  # robot 3 has the meta-model
        pass
    ears.close()
    others.append(hand.robot(4))
    run = hand.run(recorder)
    assert [process.ends() for process in others] == [0] * 5
    assert run.weights == small_run.weights
    assert topics.meta_resend(hand.name, "maml") in {row["topic"] for row in run.lines("meter.jsonl")}
    assert guarded.event("refused_not_permitted") == 0


def test_the_embedded_broker_takes_the_keys_too_and_nothing_secret_is_written(
    keys: Path, start: Any, read_run: Any, small: tuple[str, ...], small_run: Any, tmp_path: Path
) -> None:
    run = start.jouleswarm(
        "run", TOY, "--run-id", "small", "--out", str(tmp_path), "--no-figures",
        *(part for each in small for part in ("--set", each)), JOULESWARM_KEYS=str(keys),
    )  # fmt: skip
    assert run.ends() == 0, run.printed
    done = read_run(tmp_path / "small", run.printed)
    assert done.manifest["broker"]["embedded"] is True
    assert done.manifest["broker"]["url"].startswith("mqtts://127.0.0.1:")
    assert (done.weights, done.figures) == (small_run.weights, small_run.figures)
    # Bytes are those of MQTT, not of TLS: the bill is the same to the byte.
    for arm in ("maml", "fl"):
        for link in ("uplink", "downlink", "sidelink"):
            assert done.summary["arms"][arm]["bytes"][link] == small_run.summary["arms"][arm]["bytes"][link]
    written = b"".join(path.read_bytes() for path in (tmp_path / "small").rglob("*") if path.is_file())
    passwords = [path.read_text().strip() for path in keys.glob("*/password")]
    assert len(passwords) == 7
    assert not any(password.encode() in written or password in run.printed for password in passwords)


def test_a_password_in_the_url_works_and_is_masked_in_the_manifest(
    keys: Path, start: Any, read_run: Any, tmp_path: Path
) -> None:
    own = credentials_of(keys, "recorder")
    broker = start.python(
        "broker", "--port", "0", "--no-metrics", "--users", str(keys / "broker" / "users"),
        "--rights", str(keys / "broker" / "rights"), PYTHONUNBUFFERED="1",
    )  # fmt: skip
    deadline_s = time.monotonic() + 20
    while "Ctrl-C" not in broker.printed:
        assert time.monotonic() < deadline_s, broker.printed
    url = broker.printed.split()[2].rstrip(".")
    ready = tmp_path / "ready"
    recorder = start.jouleswarm(
        "record", TOY, "--run-id", "masked", "--out", str(tmp_path), "--ready-file", str(ready),
        JOULESWARM_BROKER=url.replace("//", f"//recorder:{own.password}@"),
    )  # fmt: skip
    while not ready.exists():
        assert time.monotonic() < deadline_s + 60, recorder.printed
    assert read_run(tmp_path / "masked").manifest["broker"]["url"] == url
    assert own.password not in recorder.printed


def test_a_robot_with_the_keys_of_another_scenario_says_so_at_once(
    guarded: Guarded, keys: Path, start: Any, tmp_path: Path
) -> None:
    robot = start.python(
        "jouleswarm.agents", "--scenario", TOY, "--set", "federation.robots_per_cluster=5", "--id", "9",
        "--broker", guarded.url, "--keys", str(keys), "--quiet",
    )  # fmt: skip
    assert robot.ends() == 2
    (line,) = robot.printed.splitlines()
    assert "agent-9/password" in line
    assert "jouleswarm keys init SCENARIO" in line
    run = start.jouleswarm(
        "run", TOY, "--set", "federation.robots_per_cluster=5", "--keys", str(keys), "--out", str(tmp_path)
    )
    assert run.ends() == 2
    assert "agent-5/password" in run.printed  # before anything is started or written
    assert not list(tmp_path.glob("toy-*"))
    stranger = replace(credentials_of(keys, "agent-1"), password="wrong")
    with pytest.raises(ConfigurationError, match="bad user name or password"):
        MqttBus.connect(guarded.url, "agent-1", credentials=stranger)


@pytest.mark.external
def test_mosquitto_takes_the_rights_and_the_certificates_as_they_are(
    keys: Path, start: Any, read_run: Any, small: tuple[str, ...], small_run: Any, tmp_path: Path, mosquitto_with: Any
) -> None:
    url = mosquitto_with(
        f"cafile {keys}/ca.crt\ncertfile {keys}/broker/server.crt\nkeyfile {keys}/broker/server.key\n"
        f"acl_file {keys}/broker/rights\nrequire_certificate true\nuse_identity_as_username true\n"
    ).replace("mqtt", "mqtts")
    run = start.jouleswarm(
        "run", TOY, "--broker", url, "--keys", str(keys), "--run-id", "theirs", "--out", str(tmp_path), "--no-figures",
        *(part for each in small for part in ("--set", each)),
    )  # fmt: skip
    assert run.ends() == 0, run.printed
    assert read_run(tmp_path / "theirs").weights == small_run.weights
    # What they deny is what we deny: a robot cannot send the meta-model.
    robot, center, other = (
        MqttBus.connect(url, client, credentials=credentials_of(keys, client))
        for client in ("agent-1", "datacenter", "agent-3")
    )
    other.subscribe(topics.meta_model("r", "maml"))
    robot.publish(topics.meta_model("r", "maml"), b"forged")
    robot.flush()
    center.publish(topics.meta_model("r", "maml"), b"genuine")
    message = other.receive(20)
    assert message is not None
    assert bytes(message.payload) == b"genuine"
    for bus in (robot, center, other):
        bus.close()
