"""All benchmarks that compare two sides, at sizes that take less than a quarter of an hour together, as one table.

    python -m benchmarks.all [NAME ...] [--out FILE.md]

Markdown: the machine, and a line for each that a benchmark printed: its command, the machine's load as it began, both
sides in the benchmark's own words, and the ratio. Sizes are smaller than a benchmark's own, as ratios near 1 need.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import parser
from jouleswarm.common.host import machine

PARTS = (
    "startup --robots 48 --pairs 3",
    "gradient_step",
    "datacenter_gradient --repeats 5",
    "bus_round --rounds 4 --pairs 2",
    "broker_throughput --rounds 9",
    "broker_small --rounds 3",
    "broker_metering",
    "ring_exchange --rounds 20",
    "tls --rounds 15",
    "proxy --rounds 7 --clients 300",
    "state",
    "measure --pairs 3",
    "python_meter --rounds 5",
    "rendering --frames 500",
    "memory --rounds 1",
)
LONGEST_S = 150.0
_RATIO = re.compile(r"ratio(?: throughput)? ([\d.]+)|([\d.]+) mosquitto|([\d.]+) ?x\b")


def main() -> None:
    known = parser(__doc__)
    known.add_argument("names", nargs="*", metavar="NAME", help="only these")
    known.add_argument("--out", type=Path, help="write the table to a file too")
    options = known.parse_args()
    chosen = [part for part in PARTS if not options.names or part.split()[0] in options.names]
    if unknown := set(options.names) - {part.split()[0] for part in PARTS}:
        known.error(f"{', '.join(sorted(unknown))}: expected some of {', '.join(part.split()[0] for part in PARTS)}")
    begun_s, lines = time.monotonic(), []
    for line in _table(chosen):
        print(line, flush=True)
        lines.append(line)
    print(f"{len(chosen)} benchmarks in {(time.monotonic() - begun_s) / 60:.1f} minutes", file=sys.stderr)
    if options.out is not None:
        options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _table(parts: list[str]) -> Iterator[str]:
    here = machine()
    yield f"Measured by `python -m benchmarks.all` on {here['cores']} cores of {here['processor']}, {here['system']}."
    yield ""
    yield "| `python -m benchmarks.` | load | both sides | ratio |"
    yield "|---|---|---|---|"
    for part in parts:
        load, cell = os.getloadavg()[0], f"`{part}`"
        for told in _printed(part):
            ratios = [next(filter(None, each)) for each in _RATIO.findall(told)]
            shown = told.replace("|", r"\|")
            yield f"| {cell} | {load:.1f} | {shown} | {ratios[-1] + 'x' if ratios else ''} |"
            cell = ""


def _printed(part: str) -> list[str]:
    """The lines that a benchmark prints, or why there are none."""
    command = [sys.executable, "-m", f"benchmarks.{part.split()[0]}", *part.split()[1:]]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, start_new_session=True) as process:
        try:
            out, errors = process.communicate(timeout=LONGEST_S)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            return [f"stopped after {LONGEST_S:g} s"]
    lines = [" ".join(line.split()) for line in out.splitlines() if line.strip()]
    return lines if process.returncode == 0 else [f"failed: {(errors.strip().splitlines() or ['?'])[-1]}"]


if __name__ == "__main__":
    main()
