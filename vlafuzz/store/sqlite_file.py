"""SqliteFile: an open SQLite file with one writer, whose errors are sentences."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vlafuzz.store import rows
from vlafuzz.store.database import WriterLock, explained


class SqliteFile:
    """An open file; ``lock`` is None where it is only read."""

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: WriterLock | None) -> None:
        self.path, self._connection, self._lock = path, connection, lock
        connection.row_factory = sqlite3.Row

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        assert self._lock is not None, "open the store to write"
        with explained(self.path):
            self._connection.execute("BEGIN IMMEDIATE")
            with self._connection:
                yield

    def _insert(self, table: str, row: rows.Row, conflict: str = "") -> int:
        names = ", ".join(f'"{name}"' for name in row)
        marks = ", ".join(f":{name}" for name in row)
        done = self._connection.execute(f"INSERT {conflict} INTO {table} ({names}) VALUES ({marks})", row)
        return int(done.lastrowid or 0)

    def _select(self, query: str, *values: str | int) -> list[sqlite3.Row]:
        with explained(self.path):
            return self._connection.execute(query, values).fetchall()
