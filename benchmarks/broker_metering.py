"""What metering costs the broker: time to count a packet, as a share of its processor time for the packet.

    python -m benchmarks.broker_metering

Wall time of a run with metering against one without does not resolve this: it varies by more than the cost.
"""

from __future__ import annotations

import os
import statistics

import psutil

from benchmarks.broker_throughput import CASES, FRAME_BYTES, RUN, Case, Crew, cpu_s, fan_out
from benchmarks.harness import embedded, in_turn, seconds
from jouleswarm.broker.by_rule import RuleMeter
from jouleswarm.broker.meter import BrokerMeter
from jouleswarm.common.bus.mqtt import MqttBus
from jouleswarm.common.bus.paho_client import wire_id
from jouleswarm.common.wire.links import OWN

TOPIC = f"{RUN}/ul/1/1/experience"


def count_s(by_rule: RuleMeter | None = None, repeats: int = 200_000) -> float:
    """Seconds to count one packet, by rules too."""
    meter, client_id = BrokerMeter(by_rule=by_rule), wire_id("agent-1")

    def count() -> None:
        for _ in range(repeats):
            meter.count(client_id, TOPIC, "out", FRAME_BYTES, FRAME_BYTES + 50)

    return seconds(count) / repeats


def packet_s(case: Case, rounds: int) -> float:
    """Processor seconds of an unmetered broker for one packet in or out."""
    with embedded("--no-meter") as broker:
        crew, publisher = Crew(case.crew(broker.url)), MqttBus.connect(broker.url, "publisher")
        payload, process = os.urandom(case.size_bytes), psutil.Process(broker.pid)

        def act() -> None:
            for _ in range(case.messages):
                publisher.publish(TOPIC, payload)

        crew.round_s(act)
        before_s = cpu_s(process)
        for _ in range(rounds):
            crew.round_s(act)
        spent_s = cpu_s(process) - before_s
        crew.end()
        publisher.close()
    subscribers = case.delivered_bytes // (case.messages * case.size_bytes)
    return spent_s / (rounds * case.messages * (1 + subscribers))


def main() -> None:
    found = in_turn({"plain": count_s, "by rules": lambda: count_s(RuleMeter(OWN))}, 5)
    counting_s, ruled_s = (statistics.median(each) for each in found.values())
    print(f"counting a packet: {counting_s * 1e6:.2f} us; by rules (--links) too: {ruled_s * 1e6:.2f} us")
    for case, rounds in ((fan_out(2000, 1000, 1, "1 kB to 1"), 10), *((case, 60) for case in CASES[:3])):
        handling_s = packet_s(case, rounds)
        share = counting_s / handling_s
        print(f"{case.name:20} handling a packet: {handling_s * 1e6:8.1f} us; metering adds {share:.2%} (goal: 3%)")


if __name__ == "__main__":
    main()
