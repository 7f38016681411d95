"""What does an encoding cost? `python examples/mqtt_fl/run.py [FOLDER]`

Two learners and a parameter server exchange the same small model over MQTT, by the server (topics `post model`, `PS`)
and between neighbours (`consensus`), as JSON lists, pickle, safetensors and int8. Each process counts by
`jouleswarm.Meter`; the bill of all files is printed, and FOLDER keeps them for `jouleswarm bill FOLDER`.
"""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

from payloads import ENCODINGS
from wire import ARMS, CONSENSUS, LEARNERS, SERVER

from jouleswarm import bill

HERE = Path(__file__).parent
BROKER = ("-m", "jouleswarm.broker", "--port", "0", "--no-metrics", "--exit-with-stdin")


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else scratch).absolute()
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.glob("*.csv")):
            sys.exit(f"{folder} holds counts already, expected an empty folder")
        with start(*BROKER, stdin=subprocess.PIPE) as broker:
            errors = exchange(str(json.loads(broker.stdout.readline())["url"]).rsplit(":", 1)[1], folder)
            broker.stdin.close()
        show(folder, errors)


def exchange(port: str, folder: Path) -> list[str]:
    """All three to their end; the error of each arm as the first learner tells it."""
    server = start(str(HERE / "server.py"), port, str(folder / "server.csv"))
    server.stdout.readline()  # it listens
    started = [start(str(HERE / "learner.py"), str(n), port, str(folder / f"learner-{n}.csv")) for n in LEARNERS]
    told = [process.communicate(timeout=120)[0] for process in (server, *started)]
    if any(process.returncode for process in (server, *started)):
        sys.exit("a process failed; its error is above")
    return told[1].split()


def start(*arguments: str, **options: int) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, text=True, **options)


def show(folder: Path, errors: list[str]) -> None:
    sums: dict[tuple[str, str], float] = defaultdict(float)
    for file in folder.glob("learner-*.csv"):
        for row in csv.DictReader(file.open(newline="")):
            if row["end"] == "sent" or (row["activity"], row["what"]) == ("encode", "cpu_s"):
                sums[row["arm"], row["what"].split("_", 1)[1]] += float(row["value"])
    joules = bill(folder)["fl"]
    traffic = joules[["uplink", "downlink", "sidelink_robots"]].sum(axis=1)
    found = dict(zip(ARMS, errors, strict=True))
    line = "{:12}{:>10}{:>12}{:>14}{:>12}{:>14}{:>12}"
    print(line.format("", "bytes a", "us of CPU", "J of traffic", "", "error at end", ""))
    print(line.format("", "message", "to encode", "by server", "consensus", "by server", "consensus"))
    for name in ENCODINGS:
        one, other = f"{SERVER}, {name}", f"{CONSENSUS}, {name}"
        size, cpu_s = (sums[one, what] / sums[one, "messages"] for what in ("bytes", "s"))
        costs = (f"{traffic[one]:.3f}", f"{traffic[other]:.3f}")
        print(
            line.format(name, f"{size:.0f}", f"{1e6 * cpu_s:.0f}", *costs, found[SERVER, name], found[CONSENSUS, name])
        )
    computing = joules["computing_robots"].iloc[0]
    print(f"At the prices of the paper's Table I; computing costs {computing:.4g} J in each row.")


if __name__ == "__main__":
    main()
