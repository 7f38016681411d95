"""What does an encoding cost? `python examples/mqtt_fl/run.py [FOLDER]`

Two learners and a parameter server exchange the same small model over MQTT, by the server (topics `post model`, `PS`)
and between neighbours (`consensus`), as JSON lists, pickle, safetensors and int8. `jouleswarm meter serve` counts the
bytes by the rules of links.toml, learners tell it their gradients by `jouleswarm.Meter`; the bill of each encoding is
printed, and FOLDER keeps it for `jouleswarm report FOLDER`.
"""

from __future__ import annotations

import csv
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from payloads import ENCODINGS
from wire import LEARNERS

from jouleswarm import Run

HERE = Path(__file__).parent


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else f"{scratch}/mqtt_fl").absolute()
        with metered(folder) as port:
            errors = exchange(port)
        show(folder, errors)


@contextmanager
def metered(folder: Path) -> Iterator[str]:
    """A broker that meters; its port."""
    rules = ("--links", str(HERE / "links.toml"), "--out", str(folder.parent), "--run-id", folder.name)
    with start("-m", "jouleswarm", "meter", "serve", "--listen", "127.0.0.1:0", "--facts", *rules) as meter:
        url = next((line.split()[2].strip(",;") for line in meter.stdout if line.startswith("broker at")), None)
        if url is None:
            sys.exit(meter.wait(60))  # it has said why
        yield url.rsplit(":", 1)[1]
        meter.terminate()
        meter.communicate(timeout=60)  # its report, for whoever had started it by hand


def exchange(port: str) -> list[str]:
    """All three to their end; the error of each arm as the first learner tells it."""
    server = start(str(HERE / "server.py"), port)
    server.stdout.readline()  # it listens
    started = [start(str(HERE / "learner.py"), str(number), port) for number in LEARNERS]
    told = [process.communicate(timeout=120)[0] for process in (server, *started)]
    if any(process.returncode for process in (server, *started)):
        sys.exit("a process failed; its error is above")
    return told[1].split()


def start(*arguments: str, **options: int) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, text=True, **options)


def show(folder: Path, errors: list[str]) -> None:
    run = Run(folder)
    joules, sent = run.bill()["fl"], run.meter.query("link == 'uplink' and direction == 'in'")
    posted = sent.groupby(sent["labels"].str["arm"])[["payload_bytes", "messages"]].sum()
    encoding_s = defaultdict[str, list[float]](list)
    for row in csv.DictReader(line for line in (folder / "bill.csv").open(newline="") if line[0] != "#"):
        if (row["activity"], row["what"]) == ("encode", "cpu_s"):
            encoding_s[row["arm"]].append(float(row["value"]))
    line = "{:12}{:>10}{:>12}{:>14}{:>12}{:>14}{:>12}"
    print(line.format("", "bytes a", "us of CPU", "J of traffic", "", "error at end", ""))
    print(line.format("", "message", "to encode", "by server", "consensus", "by server", "consensus"))
    for place, name in enumerate(ENCODINGS):
        size = posted.at[name, "payload_bytes"] / posted.at[name, "messages"]
        us = 1e6 * sum(encoding_s[name]) / (2 * len(encoding_s[name]))  # a round of each kind
        costs = joules.at[name, "uplink"] + joules.at[name, "downlink"], joules.at[name, "sidelink_robots"]
        told = errors[2 * place : 2 * place + 2]
        print(line.format(name, f"{size:.0f}", f"{us:.0f}", *(f"{cost:.3f}" for cost in costs), *told))
    computing = joules["computing_robots"].iloc[0]
    print(f"At the prices of the paper's Table I; computing costs {computing:.4g} J in each row, of both kinds.")


if __name__ == "__main__":
    main()
