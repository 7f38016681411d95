"""Files of a study: written whole or not at all, numbers spelled alike everywhere."""

from __future__ import annotations

from pathlib import Path

from jouleswarm.common.errors import ConfigurationError, StudyError


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write to `path`, making its folder; a reader finds the old file or the new one, never a part; text in UTF-8.

    Raises:
        ConfigurationError: the folder is none to write into.
        StudyError: it was, and the file cannot be written any more.
    """
    temporary = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
        temporary.replace(path)
    except (PermissionError, FileExistsError, NotADirectoryError) as error:
        raise ConfigurationError(f"cannot write {path}: {error.strerror}; name another with --results") from error
    except OSError as error:
        raise StudyError(f"cannot write {path}: {error.strerror}; name another folder with --results") from error


def number_text(value: object) -> str:
    """A CSV cell that reads back as the same value: whole floats without a point, "" for None."""
    if value is None:
        return ""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value)
