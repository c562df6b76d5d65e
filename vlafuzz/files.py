"""Files and folders that are written whole or not at all."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vlafuzz.errors import UsageError


def reason(error: OSError) -> str:
    """Why the system refused, for a message."""
    return (error.strerror or "unknown reason").lower()


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A place beside ``path`` for a new file or folder, moved to ``path`` in the end and removed on failure.

    Raises:
        OSError: it cannot be written, or ``path`` is a folder that is not empty.
    """
    unfinished = path.with_name(f".{path.name}.part")
    _remove(unfinished)  # of a process that was killed
    try:
        yield unfinished
        unfinished.replace(path)
    finally:
        _remove(unfinished)


def write_whole(path: Path, text: str) -> None:
    """Write a text file; readers see the old one or all of the new one.

    Raises:
        OSError: it cannot be written.
    """
    with replacing(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8")


def make_folder(folder: Path, flag: str = "--out") -> None:
    """Make a folder that a flag names, unless it exists.

    Raises:
        UsageError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"{flag}: {folder}: cannot be made: {reason(error)}"
        raise UsageError(message, hint="give another folder") from None


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
