"""Merging stores: all runs and trials of several, and each finding once."""

import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from vlafuzz.errors import StoreError
from vlafuzz.store.database import WriterLock, connect_to_read, connect_to_write, explained
from vlafuzz.store.store import Store

# Table → columns that number a row, with the table that it is in; "id" is the row's own number. Tables come
# after those that they refer to.
NUMBERS: dict[str, dict[str, str]] = {
    "run": {"id": "run"},
    "scene": {},
    "trial": {"id": "trial", "run": "run"},
    "rollout": {"trial": "trial"},
    "finding": {"run": "run", "trial": "trial"},
    "triage": {},
    "attribution": {"run": "run"},
    "cause": {"run": "run"},
    "solution": {},
}
# How far the evidence in each bucket goes.
_RANK = "CASE {}.bucket WHEN 'minimal' THEN 3 WHEN 'witnessed' THEN 2 WHEN 'unproven' THEN 1 ELSE 0 END"
_CONFLICT = {
    "scene": "ON CONFLICT DO NOTHING",
    "finding": "ON CONFLICT DO NOTHING",
    "solution": "ON CONFLICT DO NOTHING",
    # Triaged in both stores: the one with more evidence is kept.
    "triage": "ON CONFLICT (scene, policy_key) DO UPDATE SET {all}"
    f" WHERE {_RANK.format('excluded')} > {_RANK.format('triage')}",
}


@dataclass(frozen=True)
class Merged:
    """Counts of a merged store."""

    runs: int
    trials: int
    findings: int


def merge(sources: Sequence[Path], out: Path) -> Merged:
    """Write a new store with everything in the sources. Runs are renumbered in the order of the sources.

    After an error, such as a StoreError since ``out`` exists, ``out`` is not created.
    """
    for source in sources:
        Store.open(source).close()  # brings an older one up to date
    lock = WriterLock(out)
    unfinished = out.with_name(out.name + ".part")
    try:
        if out.exists():
            raise StoreError(f"{out}: exists already", hint="give the name of a new file")
        _remove(unfinished)  # of a merge that was killed
        with explained(out), closing(connect_to_write(unfinished)) as target:
            for source in sources:
                target.execute("BEGIN IMMEDIATE")
                with target:
                    _copy(source, target)
            counts = [target.execute(f"SELECT count(*) FROM {table}") for table in ("run", "trial", "finding")]
            merged = Merged(*(count.fetchone()[0] for count in counts))
        unfinished.replace(out)
        return merged
    finally:
        _remove(unfinished)
        lock.release()


def _copy(path: Path, target: sqlite3.Connection) -> None:
    with explained(path):
        source = connect_to_read(path)
    with closing(source):
        source.execute("BEGIN")  # one consistent state of a store that may be being written
        queries = {table: f"SELECT coalesce(max(id), 0) FROM {table}" for table in ("run", "trial")}
        shift = {table: int(target.execute(query).fetchone()[0]) for table, query in queries.items()}
        for table, numbers in NUMBERS.items():
            _copy_table(source, target, table, {column: shift[of] for column, of in numbers.items()})


def _copy_table(source: sqlite3.Connection, target: sqlite3.Connection, table: str, shift: Mapping[str, int]) -> None:
    columns = [row[1] for row in target.execute(f"PRAGMA table_info({table})")]
    if "id" in columns and "id" not in shift:
        columns.remove("id")  # no other table refers to it, so the target numbers its own
    names = ", ".join(f'"{column}"' for column in columns)
    shifted = {column: f" + {number}" for column, number in shift.items()}
    values = ", ".join(f'"{column}"{shifted.get(column, "")}' for column in columns)
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
