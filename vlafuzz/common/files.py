"""Files and folders that are written whole or not at all; devices and pipes, which are written in place."""

import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from vlafuzz.errors import UsageError

ELSEWHERE = "name a file in a folder of yours"


def reason(error: OSError) -> str:
    """Why the system refused, for a message."""
    return (error.strerror or "unknown reason").lower()


@contextmanager
def writing(path: Path, hint: str = ELSEWHERE, problem: type[UsageError] = UsageError) -> Iterator[None]:
    """Make the folder of what is written in this block; a ``problem`` if the system refuses."""
    try:
        with suppress(FileExistsError):  # a file there is what the block then complains about
            path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise problem(f"{path}: cannot be written: {reason(error)}", hint) from None


@contextmanager
def closed_on_error(connection: Any) -> Iterator[None]:
    """Close a connection when the block raises, which prepares it."""
    try:
        yield
    except BaseException:
        connection.close()
        raise


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A place for a new file or folder, moved to ``path`` in the end and removed on failure.

    Where ``path`` is a link, its target is replaced; a device or a pipe is written to. OSError if it cannot be.
    """
    if is_stream(path):
        with TemporaryDirectory(prefix="vlafuzz-") as folder:
            unfinished = Path(folder) / path.name
            yield unfinished
            with path.open("wb") as stream:
                stream.write(unfinished.read_bytes())
        return
    target = path.resolve()
    unfinished = target.with_name(f".{target.name}.part")
    _remove(unfinished)  # of a process that was killed
    try:
        yield unfinished
        unfinished.replace(target)
    finally:
        _remove(unfinished)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, text as UTF-8; readers see the old one or all of the new one. OSError if it cannot be."""
    with replacing(path) as unfinished:
        unfinished.write_bytes(content.encode() if isinstance(content, str) else content)


def is_stream(path: Path) -> bool:
    """Whether a path leads to a device, a pipe or a socket, which can be written to but not replaced."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
