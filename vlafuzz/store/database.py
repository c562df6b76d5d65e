"""Opening a store's file: one writer, many readers, and one sentence for anything that is wrong with it."""

import errno
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

from filelock import FileLock, Timeout
from pydantic import ValidationError

from vlafuzz.common.files import closed_on_error, reason
from vlafuzz.common.reading import first_problem
from vlafuzz.errors import StoreError, VlafuzzError
from vlafuzz.store.migrations import STEPS, migrate

APPLICATION_ID = 0x766C6166  # "vlaf": what `file` and SQLite's tools show
MOST_BYTES = 64 << 20  # of one value or row; ours have kilobytes
BRIEFLY = 2.0  # seconds to wait for readers, in which a page of those who follow a run is made
BUSY = 10.0  # seconds to wait for another process's transaction; ours take milliseconds

_EXPLAINED = {
    "SQLITE_NOTADB": ("is not a store of vlafuzz", "give a store that `vlafuzz run` wrote"),
    "SQLITE_CORRUPT": ("is damaged", "`sqlite3 STORE .recover | sqlite3 NEW.db` saves what is readable"),
    "SQLITE_EMPTY": ("is empty", "`vlafuzz run --store STORE` fills it"),
    "SQLITE_FULL": ("the disk is full", "make room; all trials up to here are stored, --resume goes on"),
    "SQLITE_READONLY": ("cannot be written", "give a store in a folder that you may write to"),
    "SQLITE_CANTOPEN": ("cannot be opened", "check that you may read and write its folder"),
    "SQLITE_BUSY": ("another process keeps it busy", "try again when that has ended"),
    "SQLITE_CONSTRAINT": ("is damaged: {}", "restore it from a backup"),
    "SQLITE_TOOBIG": ("is damaged: a value has more than 64 MiB", "restore it from a backup"),
    "SQLITE_ERROR": ("is damaged: {}", "give a store that `vlafuzz run` wrote"),
    "SQLITE_IOERR": ("cannot be read or written", "check the disk; all trials up to here are stored"),
}


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Turn SQLite's errors about a file into a StoreError; programming errors pass through."""
    try:
        yield
    except sqlite3.ProgrammingError:
        raise
    except sqlite3.Error as error:
        name = getattr(error, "sqlite_errorname", "SQLITE_CORRUPT")  # none: a text is not UTF-8
        for prefix in _EXPLAINED:
            if name.startswith(prefix):
                raise _problem(path, prefix, str(error)) from error
        raise


@contextmanager
def intact(path: Path) -> Iterator[None]:
    """Turn errors about what is in a store's rows, such as JSON that somebody changed, into a StoreError."""
    try:
        yield
    except StoreError as error:
        raise StoreError(f"{path}: {error.message.removeprefix(f'{path}: ')}", error.hint) from None
    except (VlafuzzError, ValueError, LookupError) as error:
        problem = first_problem(error) if isinstance(error, ValidationError) else str(error)
        raise StoreError(f"{path}: is damaged: {problem}", hint="restore it from a backup") from None


def _problem(path: Path, name: str, detail: str = "a reference leads nowhere") -> StoreError:
    what, hint = _EXPLAINED[name]
    return StoreError(f"{path}: {what.format(detail)}", hint=hint.replace("STORE", str(path)))


def connect_to_write(path: Path) -> sqlite3.Connection:
    """Open a store, or create one. The caller holds the lock."""
    if path.exists() and not os.access(path, os.W_OK):  # SQLite would open it, and fail at the first write
        raise _problem(path, "SQLITE_READONLY")
    connection = sqlite3.connect(path, timeout=BUSY, isolation_level=None)
    with closed_on_error(connection):
        _check(path, connection, new_allowed=True)
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA foreign_keys = ON")
        migrate(connection, APPLICATION_ID)
    return connection


def gather(connection: sqlite3.Connection) -> None:
    """Move what was written into the store's own file, so that a copy of it has everything.

    SQLite does so when the last one closes a store, but somebody may follow a run for days.
    """
    connection.execute(f"PRAGMA busy_timeout = {round(1000 * BRIEFLY)}")
    with suppress(sqlite3.Error):  # it stays in the other file
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def check_is_file(path: Path) -> None:
    """Raise a StoreError if a path is a folder."""
    if path.is_dir():
        raise StoreError(f"{path}: is a folder", hint="give the file of a store in it")


def connect_to_read(path: Path) -> sqlite3.Connection:
    """Open an existing store."""
    check_is_file(path)
    if not path.is_file():
        raise StoreError(f"{path}: no such store", hint="`vlafuzz run` writes one; check the path")
    connection = _reader(path)
    with closed_on_error(connection):
        _check(path, connection, new_allowed=False)
    return connection


def is_outdated(connection: sqlite3.Connection) -> bool:
    """Whether an earlier version of vlafuzz wrote the store."""
    return int(_pragma(connection, "user_version")) < max(STEPS)


def _reader(path: Path) -> sqlite3.Connection:
    uri = f"file:{quote(str(path.absolute()))}?mode="
    # Not "ro" where that can be avoided: it would leave SQLite's two files beside the store.
    connection = sqlite3.connect(uri + "rw", uri=True, timeout=BUSY, isolation_level=None)
    try:
        with closed_on_error(connection):
            connection.execute("PRAGMA query_only = ON")
            _pragma(connection, "user_version")
    except sqlite3.OperationalError:
        # Even reading makes a WAL file beside the store, which a read-only folder does not allow.
        if os.access(path.parent, os.W_OK) or path.with_name(path.name + "-wal").exists():
            raise
        return sqlite3.connect(uri + "ro&immutable=1", uri=True, isolation_level=None)
    return connection


def _check(path: Path, connection: sqlite3.Connection, *, new_allowed: bool) -> None:
    try:
        _check_content(path, connection, new_allowed=new_allowed)
    except (sqlite3.OperationalError, UnicodeDecodeError) as error:  # the latter from SQLite's own message
        if getattr(error, "sqlite_errorname", "SQLITE_ERROR") != "SQLITE_ERROR":
            raise
        raise _problem(path, "SQLITE_CORRUPT") from None


def _check_content(path: Path, connection: sqlite3.Connection, *, new_allowed: bool) -> None:
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
    connection.execute("PRAGMA trusted_schema = OFF")
    (tables,) = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    application = _pragma(connection, "application_id")
    if tables == 0 and application == 0:
        if not new_allowed:
            raise _problem(path, "SQLITE_EMPTY")
        return
    if application != APPLICATION_ID:
        raise _problem(path, "SQLITE_NOTADB")
    version = _pragma(connection, "user_version")
    if version < 1:
        raise _problem(path, "SQLITE_CORRUPT")
    if version > max(STEPS):
        problem = f"its schema is {version}, newer than {max(STEPS)}, the newest known here"
        raise StoreError(f"{path}: {problem}", hint="upgrade vlafuzz")
    if version < min(STEPS):
        problem = f"its schema is {version}, older than {min(STEPS)}, the oldest known here"
        raise StoreError(f"{path}: {problem}", hint="export it with the version of vlafuzz that wrote it")
    if _lacks_part_of_a_page(path, connection) or _pragma(connection, "quick_check(1)") != "ok":
        raise _problem(path, "SQLITE_CORRUPT")
    if connection.execute("SELECT 1 FROM pragma_foreign_key_check LIMIT 1").fetchone():
        raise _problem(path, "SQLITE_CONSTRAINT")


def _lacks_part_of_a_page(path: Path, connection: sqlite3.Connection) -> bool:
    """Whether the file ends within a page; SQLite reads the missing part as zeros."""
    with suppress(FileNotFoundError):
        if path.with_name(path.name + "-wal").stat().st_size:
            return False  # the rest of the page may be in there
    return path.stat().st_size % int(_pragma(connection, "page_size")) != 0


def _pragma(connection: sqlite3.Connection, name: str) -> Any:
    return connection.execute(f"PRAGMA {name}").fetchone()[0]


def _lock_of(path: Path) -> FileLock:
    """The lock beside a store, the same one for a link to it."""
    return FileLock(f"{path.resolve()}.lock", blocking=False, thread_local=False)


def is_being_written(path: Path) -> bool:
    """Whether a process writes to a store at present."""
    lock = _lock_of(path)
    try:
        if os.path.exists(lock.lock_file):
            with lock:
                pass
    except Timeout:
        return True
    except OSError:
        pass
    return False


class WriterLock:
    """Held by the one process that writes to a store. The kernel releases it however that process ends."""

    def __init__(self, path: Path) -> None:
        check_is_file(path)
        self._lock = _lock_of(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock.acquire()
        except Timeout:
            hint = "wait until it ends, or give another store"
            raise StoreError(f"{path}: another process is writing to it", hint) from None
        except OSError as error:
            if error.errno == errno.ENOSPC:
                raise _problem(path, "SQLITE_FULL") from None
            hint = _EXPLAINED["SQLITE_READONLY"][1]
            raise StoreError(f"{path}: cannot be written: {reason(error)}", hint) from None

    def release(self) -> None:
        # Removed before the lock is released: afterwards it may be another process's file.
        Path(self._lock.lock_file).unlink(missing_ok=True)
        self._lock.release()
