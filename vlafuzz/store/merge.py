"""Several stores as one: all their runs and trials, and each finding once."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from vlafuzz.errors import StoreError
from vlafuzz.store.database import WriterLock, connect_to_read, connect_to_write, explained
from vlafuzz.store.records import EVIDENCE, EVIDENCE_OF
from vlafuzz.store.store import Store

# Table → columns with the number of a row, and the table that it is in. Where the first is "id", it is the
# row's own. Tables come after those that they refer to.
NUMBERS: dict[str, dict[str, str]] = {
    "run": {"id": "run"},
    "scene": {},
    "trial": {"id": "trial", "run": "run"},
    "rollout": {"trial": "trial"},
    "finding": {"run": "run", "trial": "trial"},
    "triage": {},
}
_RANK = "CASE {}.evidence " + " ".join(f"WHEN '{name}' THEN {n}" for n, name in enumerate(EVIDENCE)) + " END"
_RANKS = " ".join(f"WHEN '{bucket}' THEN {EVIDENCE.index(name)}" for bucket, name in EVIDENCE_OF.items())
_BUCKET_RANK = f"CASE {{}}.bucket {_RANKS} END"
_CONFLICT = {
    "scene": "ON CONFLICT DO NOTHING",
    # Known in both stores: kept once, as the store with more evidence has it.
    "finding": "ON CONFLICT (scene, policy_key) DO UPDATE SET"
    " run = excluded.run, trial = excluded.trial, evidence = excluded.evidence, cell = excluded.cell"
    f" WHERE {_RANK.format('excluded')} > {_RANK.format('finding')}",
    "triage": "ON CONFLICT (scene, policy_key) DO UPDATE SET {all}"
    f" WHERE {_BUCKET_RANK.format('excluded')} > {_BUCKET_RANK.format('triage')}",
}


@dataclass(frozen=True)
class Merged:
    """What a merged store holds."""

    runs: int
    trials: int
    findings: int


def merge(sources: Sequence[Path], out: Path) -> Merged:
    """Write a new store with everything in the sources. Runs are numbered anew, in the order given.

    Raises:
        StoreError: ``out`` is there already, or a store cannot be read or written; then there is no ``out``.
    """
    for source in sources:
        Store.open(source).close()  # brings an older one up to date
    lock = WriterLock(out)
    unfinished = out.with_name(out.name + ".part")
    try:
        if out.exists():
            raise StoreError(f"{out}: is there already", hint="give the name of a new file")
        _remove(unfinished)  # of a merge that was killed
        merged = _write(sources, unfinished, out)
        unfinished.replace(out)
        return merged
    finally:
        _remove(unfinished)
        lock.release()


def _write(sources: Sequence[Path], path: Path, named: Path) -> Merged:
    with explained(named), closing(connect_to_write(path)) as target:
        for source in sources:
            with _transaction(target):
                _copy(source, target)
        counts = [target.execute(f"SELECT count(*) FROM {table}") for table in ("run", "trial", "finding")]
        return Merged(*(count.fetchone()[0] for count in counts))


@contextmanager
def _transaction(connection: sqlite3.Connection) -> Iterator[None]:
    connection.execute("BEGIN IMMEDIATE")
    with connection:
        yield


def _copy(path: Path, target: sqlite3.Connection) -> None:
    with explained(path):
        source = connect_to_read(path)
    with closing(source):
        source.execute("BEGIN")  # one moment of a store that somebody may be writing to
        shift = {table: _last(target, table) for table in ("run", "trial")}
        for table, numbers in NUMBERS.items():
            _copy_table(source, target, table, {column: shift[of] for column, of in numbers.items()})


def _last(connection: sqlite3.Connection, table: str) -> int:
    return int(connection.execute(f"SELECT coalesce(max(id), 0) FROM {table}").fetchone()[0])


def _copy_table(
    source: sqlite3.Connection, target: sqlite3.Connection, table: str, shift: Mapping[str, int]
) -> None:
    columns = [row[1] for row in source.execute(f"PRAGMA table_info({table})")]
    if "id" in columns and "id" not in shift:
        columns.remove("id")  # nobody refers to it: the target numbers its own
    names = ", ".join(f'"{column}"' for column in columns)
    values = ", ".join(
        f'"{column}" + {shift[column]}' if column in shift else f'"{column}"' for column in columns
    )
    marks = ", ".join("?" * len(columns))
    everything = ", ".join(f'"{column}" = excluded."{column}"' for column in columns)
    conflict = _CONFLICT.get(table, "").replace("{all}", everything)
    order = "" if table == "rollout" else " ORDER BY rowid"
    target.executemany(
        f"INSERT INTO {table} ({names}) VALUES ({marks}) {conflict}",
        source.execute(f"SELECT {values} FROM {table}{order}"),
    )


def _remove(path: Path) -> None:
    for suffix in ("", "-wal", "-shm"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
