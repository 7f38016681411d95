"""Spoilt payloads against every decoder: each is decoded to what the decoder promises, or refused as PayloadError.

    python -m fuzz.payloads [--payloads 1000000] [--seed 1] [--minutes 10] [--atheris] [--out DIR]

Everything else is a defect: another exception, a broken promise, a second for one payload, memory that grows. The
input is then kept under --out and the exit code is 1. --atheris lets coverage guide the mutations (pip install
".[fuzz]"); without it a seed gives the same payloads each time.
"""

from __future__ import annotations

import hashlib
import logging
import os
import random
import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from benchmarks.harness import MEGABYTE, parser
from fuzz.mutations import mutate
from fuzz.targets import Target, targets
from jouleswarm.common.errors import PayloadError

RSS_LIMIT_BYTES = 64 * MEGABYTE
SLOW_S = 1.0
WARM_UP = 0.1  # of the payloads: caches and imports are no growth


@dataclass
class Tally:
    """What became of one decoder's inputs."""

    accepted: int = 0
    refused: int = 0
    crashes: list[str] = field(default_factory=list)
    slowest_s: float = 0.0

    @property
    def tried(self) -> int:
        return self.accepted + self.refused + len(self.crashes)


def judge(target: Target, payload: bytes, tally: Tally) -> str | None:
    """Decode one payload and count what came of it; what was wrong, if anything was."""
    begun_s, wrong = time.perf_counter(), None
    try:
        target.decode(payload)
        tally.accepted += 1
    except PayloadError:
        tally.refused += 1
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # noqa: BLE001 - whatever it is, it is what is looked for
        wrong = f"{type(error).__name__}: {error}"[:200]
    took_s = time.perf_counter() - begun_s
    tally.slowest_s = max(tally.slowest_s, took_s)
    if wrong is None and took_s > SLOW_S:
        wrong = f"took {took_s:.1f} s"
    if wrong is not None:
        tally.crashes.append(wrong)
    return wrong


def keep(out: Path, target: Target, payload: bytes) -> Path:
    """Write down an input that something is wrong with."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{target.name.replace(' ', '-')}-{hashlib.sha256(payload).hexdigest()[:12]}.bin"
    path.write_bytes(payload)
    return path


@dataclass
class Outcome:
    """Of a whole run."""

    tallies: dict[str, Tally]
    seconds: float = 0.0
    rss_growth_bytes: int = 0
    peak_growth_bytes: int = 0

    @property
    def is_clean(self) -> bool:
        return not any(each.crashes for each in self.tallies.values()) and self.peak_growth_bytes <= RSS_LIMIT_BYTES


def fuzz(every: Sequence[Target], payloads: int, seed: int, out: Path, minutes: float | None = None) -> Outcome:
    """Try spoilt payloads, one decoder after the other."""
    rng, process = random.Random(seed), psutil.Process()
    pieces = tuple(payload for target in every for payload in target.seeds)
    outcome = Outcome({target.name: Tally() for target in every})
    begun_s, rss, peak = time.monotonic(), 0, 0
    for number in range(payloads):
        if number == int(payloads * WARM_UP):
            rss, peak = process.memory_info().rss, peak_bytes()
        target = every[number % len(every)]
        payload = mutate(rng, rng.choice(target.seeds), pieces)
        if wrong := judge(target, payload, outcome.tallies[target.name]):
            print(f"{target.name}: {wrong}; kept as {keep(out, target, payload)}", file=sys.stderr)
        if minutes is not None and number % 1000 == 0 and time.monotonic() - begun_s > minutes * 60:
            break
    outcome.seconds = time.monotonic() - begun_s
    outcome.rss_growth_bytes = process.memory_info().rss - rss if rss else 0
    outcome.peak_growth_bytes = peak_bytes() - peak if peak else 0
    return outcome


def peak_bytes() -> int:
    """The most memory that this process has ever held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def silence_libraries() -> None:
    """libpng writes a line to file descriptor 2 for every picture that it cannot read; Python's stderr stays."""
    sys.stderr = os.fdopen(os.dup(2), "w", buffering=1)
    with open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), 2)


def show(outcome: Outcome) -> None:
    """The table."""
    print(f"{'decoder':16}{'tried':>10}{'accepted':>10}{'refused':>10}{'crashes':>9}{'slowest, ms':>13}")
    for name, tally in outcome.tallies.items():
        print(
            f"{name:16}{tally.tried:10}{tally.accepted:10}{tally.refused:10}{len(tally.crashes):9}"
            f"{tally.slowest_s * 1e3:13.1f}"
        )
    tried = sum(each.tried for each in outcome.tallies.values())
    accepted = sum(each.accepted for each in outcome.tallies.values())
    print(
        f"{tried} inputs in {outcome.seconds:.0f} s ({tried / max(outcome.seconds, 1e-9):.0f}/s), {accepted} accepted; "
        f"after warm-up memory grew by {outcome.rss_growth_bytes / MEGABYTE:.1f} MB, its peak by "
        f"{outcome.peak_growth_bytes / MEGABYTE:.1f} MB (limit {RSS_LIMIT_BYTES / MEGABYTE:.0f})"
    )


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--payloads", type=int, default=1_000_000)
    known.add_argument("--seed", type=int, default=1)
    known.add_argument("--minutes", type=float, help="stop earlier")
    known.add_argument("--out", type=Path, default=Path("fuzz-findings"), help="where bad inputs are kept")
    known.add_argument("--target", help="only decoders whose name contains this")
    known.add_argument("--atheris", action="store_true", help="guided by coverage")
    options = known.parse_args()
    logging.disable()
    silence_libraries()
    if options.atheris:
        from fuzz.atheris_payloads import run

        sys.exit(run(options.payloads, options.seed, options.out))
    every = [each for each in targets() if not options.target or options.target in each.name]
    outcome = fuzz(every, options.payloads, options.seed, options.out, options.minutes)
    show(outcome)
    sys.exit(0 if outcome.is_clean else 1)


if __name__ == "__main__":
    main()
