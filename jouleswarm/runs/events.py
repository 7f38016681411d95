"""What happened in a run beside learning: a process ended and was started again, the broker refused something."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from jouleswarm.runs.files import read_lines

EVENTS = Path("logs") / "events.jsonl"


class Event(BaseModel):
    """A line of the file."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    time_s: float
    """Since 1970."""
    text: str


def note_event(run: Path, event: Event) -> None:
    """Add one to a run directory; it is for readers only, and no bill is of it."""
    path = run / EVENTS
    path.parent.mkdir(exist_ok=True)
    with path.open("ab") as file:
        file.write(event.model_dump_json().encode() + b"\n")


def read_events(run: Path) -> list[Event]:
    """All so far; none of a run that was only recorded.

    Raises:
        RunError: the file is damaged; a torn last line is not damage.
    """
    return read_lines(run / EVENTS, Event, needed=False, cut=[])
