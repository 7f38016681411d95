"""The same oracle with mutations that coverage guides (libFuzzer by way of atheris). Run by fuzz_payloads --atheris."""

from __future__ import annotations

import importlib.util
import logging
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MAX_BYTES = 16 * 1024


def run(executions: int, seed: int, out: Path) -> int:
    """Fuzz in a process of its own (libFuzzer ends it); returns the exit code."""
    if importlib.util.find_spec("atheris") is None:
        print('coverage-guided fuzzing needs atheris: pip install ".[fuzz]"', file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as corpus:
        arguments = [str(executions), str(seed), str(out), corpus]
        return subprocess.run([sys.executable, "-m", "fuzz.atheris_payloads", *arguments], check=False).returncode


def main() -> None:
    executions, seed, out, corpus = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]), Path(sys.argv[4])
    import atheris

    with atheris.instrument_imports(include=["common"], enable_loader_override=False):
        from fuzz.targets import targets
    from fuzz.mutations import mutate
    from fuzz.payloads import Outcome, Tally, judge, keep, peak_bytes, show, silence_libraries

    every = targets()
    pieces = tuple(payload for target in every for payload in target.seeds)
    for index, target in enumerate(every):
        for place, payload in enumerate(target.seeds):
            (corpus / f"{index}-{place}").write_bytes(bytes([index]) + payload)
    outcome, begun_s = Outcome({target.name: Tally() for target in every}), time.monotonic()
    done, peak = 0, 0

    def one_input(data: bytes) -> None:
        nonlocal done, peak
        target = every[data[0] % len(every)] if data else every[0]
        if wrong := judge(target, data[1:], outcome.tallies[target.name]):
            print(f"{target.name}: {wrong}; kept as {keep(out, target, data[1:])}", file=sys.stderr)
        done += 1
        if done == executions // 10:
            peak = peak_bytes()
        if done >= executions:  # libFuzzer would end the process before the table is shown
            outcome.seconds = time.monotonic() - begun_s
            outcome.peak_growth_bytes = peak_bytes() - peak
            outcome.rss_growth_bytes = outcome.peak_growth_bytes
            show(outcome)
            sys.stdout.flush()
            os._exit(0 if outcome.is_clean else 1)

    def custom(data: bytes, max_size: int, mutation_seed: int) -> bytes:
        rng = random.Random(mutation_seed)
        if rng.random() < 0.5 or not data:
            return atheris.Mutate(data, len(data))  # libFuzzer's own
        return (data[:1] + mutate(rng, data[1:], pieces))[:max_size]

    logging.disable()
    silence_libraries()
    options = [f"-seed={seed}", f"-max_len={MAX_BYTES}", "-verbosity=0", "-rss_limit_mb=0"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], one_input, custom_mutator=custom)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
