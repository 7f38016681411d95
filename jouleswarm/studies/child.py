"""`python -m jouleswarm.studies.child FOLDER RUN`: leads one job's deployment, started by `studies.deployment`.

FOLDER holds the scenario and its overrides; the run directory FOLDER/RUN and the facts are written there. It ends,
and all processes of the deployment with it, when its stdin is closed: by whoever started it, or by that one's end.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path

from rich.console import Console

from jouleswarm.common.errors import StudyError
from jouleswarm.common.process import one_line_errors
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.fleet.deploy import run_deployment
from jouleswarm.runs.run import load_run
from jouleswarm.studies.collect import facts_of
from jouleswarm.studies.deployment import FACTS, SETTINGS
from jouleswarm.studies.facts import write_facts


def lead(folder: Path, name: str) -> None:
    """Run the deployment and write its facts.

    Raises:
        StudyError: the run is not complete, or its counters contradict each other.
        JouleSwarmError: the deployment failed.
    """
    file = folder / "scenario.toml"
    settings = (folder / SETTINGS).read_text(encoding="utf-8").splitlines()
    quiet = Console(quiet=True, force_terminal=False)
    path = run_deployment(load_scenario(file, settings), name, folder, quiet)
    run = load_run(path)
    if run.status != "complete":
        raise StudyError(f"the run is {run.status}, expected complete; see {path}")
    if run.misfits:
        raise StudyError(f"the counters of broker and clients do not fit, expected that they do; see {path}")
    write_facts(folder / FACTS, facts_of(run))


def main() -> None:
    """Entry point: errors of ours are one line and their exit code."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    folder, name = sys.argv[1:]
    try:
        # In here: a stdin that is closed already breaks off what comes next, whatever that is.
        threading.Thread(target=_end_with_stdin, name="stdin", daemon=True).start()
        with one_line_errors(name):
            lead(Path(folder), name)
    except KeyboardInterrupt as stop:
        print(str(stop) or "stopped", file=sys.stderr)
        raise SystemExit(130) from None


def _end_with_stdin() -> None:
    # Not by sys.stdin: the interpreter could not take its lock from this thread when it ends.
    while os.read(0, 1):
        pass
    # To the main thread, so that whatever it waits for is broken off. SIGTERM: SIGINT may be blocked here.
    ident = threading.main_thread().ident
    if ident is not None:
        signal.pthread_kill(ident, signal.SIGTERM)


if __name__ == "__main__":
    main()
