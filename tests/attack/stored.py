"""Corpora and stores that somebody changed, each as a function of random numbers and a folder."""

import hashlib
import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from tests.attack import mutators, samples
from tests.attack.reactions import command
from tests.attack.readers import Reader, Rng
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.failures.corpus.pairs import probes
from vlafuzz.report.page import render
from vlafuzz.report.sources import view_of_corpus, view_of_store
from vlafuzz.store.store import Store
from vlafuzz.worlds import provenance, world_of


def changed_corpus(rng: Rng, folder: Path) -> Path:
    copied = Path(shutil.copytree(samples.corpus(), folder / "corpus"))
    files = sorted(path for path in copied.rglob("*") if path.is_file())
    path = files[int(rng.integers(len(files)))] if rng.random() < 0.5 else copied / "manifest.json"
    if path.suffix == ".json" and rng.random() < 0.8:
        path.write_text(json.dumps(mutators.tree(rng, json.loads(path.read_text()))))
    else:
        path.write_bytes(mutators.data(rng, path.read_bytes()))
    if path.suffix == ".npy" and rng.random() < 0.8:  # a forged one, whose digest is right
        manifest = json.loads((copied / "manifest.json").read_text())
        for case in manifest["cases"]:
            if case["scene"] == path.stem:
                case["witness"]["digest"] = hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()
        (copied / "manifest.json").write_text(json.dumps(manifest))
    return copied


def corpus(rng: Rng, folder: Path) -> None:
    copied = changed_corpus(rng, folder)
    read = read_corpus(copied)
    probes(read)
    render(view_of_corpus(copied, read))
    _use(copied, read.runs)
    for case in read.cases:
        assert case.title is not None
        case.witness.actions.sum()


def _use(source: Path, runs: Any) -> None:
    """What all commands do with the conditions of runs."""
    for run in runs:
        run.key()
        run.comparable(runs[0])
        provenance.in_words(run.place)
        world_of(run.task).stored_space(source, run).nominal()


def store_rows(rng: Rng, folder: Path) -> None:
    """Values, rows, tables and columns that somebody changed with SQLite's own means."""
    _read_store(rng, changed_store(rng, samples.store(), folder))


def changed_store(rng: Rng, sample: Path, folder: Path) -> Path:
    path = Path(shutil.copy(sample, folder / "a.db"))
    with closing(sqlite3.connect(path)) as raw:
        raw.executescript("PRAGMA ignore_check_constraints = ON; PRAGMA foreign_keys = OFF")
        for _ in range(int(rng.integers(1, 4))):
            try:
                _edit(rng, raw)
            except (sqlite3.Error, OverflowError, ValueError):
                continue  # SQLite takes no such value
        raw.commit()
    return path


def _edit(rng: Rng, raw: sqlite3.Connection) -> None:
    tables = [name for (name,) in raw.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
    table = str(rng.choice(tables))
    columns = [row[1] for row in raw.execute(f"PRAGMA table_info({table})")]
    column = str(rng.choice(columns))
    if rng.random() < 0.08:
        statements = (
            f'ALTER TABLE {table} RENAME COLUMN "{column}" TO "x"" FROM run; --"',
            f'ALTER TABLE {table} DROP COLUMN "{column}"',
            f"ALTER TABLE {table} ADD COLUMN more",
            f"ALTER TABLE {table} RENAME TO other",
            f"CREATE TRIGGER t AFTER INSERT ON {table} BEGIN DELETE FROM run; END",
            f"CREATE VIEW v AS SELECT * FROM {table}",
            f"DROP TABLE {table}",
            f"DELETE FROM {table}",
            f"PRAGMA user_version = {rng.integers(-2, 20)}",
        )
        raw.execute(str(rng.choice(statements)))
        return
    (old,) = raw.execute(f'SELECT "{column}" FROM {table} ORDER BY random() LIMIT 1').fetchone() or (None,)
    new: Any = mutators.hostile(rng)
    if isinstance(old, bytes):
        new = mutators.data(rng, old)
    elif isinstance(old, str) and old[:1] in "[{" and rng.random() < 0.8:
        new = json.dumps(mutators.tree(rng, json.loads(old)))
    elif isinstance(old, str) and rng.random() < 0.4:
        new = mutators.text(rng, old)
    elif isinstance(new, list | dict):
        new = json.dumps(new)
    cast = " CAST(? AS BLOB)" if rng.random() < 0.03 else "?"
    raw.execute(f'UPDATE OR IGNORE {table} SET "{column}" = {cast}', (new,))


def store_bytes(rng: Rng, folder: Path) -> None:
    path = folder / "a.db"
    path.write_bytes(mutators.data(rng, samples.store().read_bytes()))
    _read_store(rng, path)


def _read_store(rng: Rng, path: Path) -> None:
    with Store.open(path) as store:
        runs = store.runs()
        for run in runs:
            trials = list(store.trials(run.id))
            store.stored(run.id, 0, 10), store.outcomes_by_scene(run.id), store.causes(run.id), store.findings(run.id)
            if trials:
                store.known(trials[0].scene, run.manifest.key())
        store.triaged(), store.findings()
        if rng.random() < 0.3:
            _use(path, [run.manifest for run in runs])
        if rng.random() < 0.3:
            render(view_of_store(store))
    commands: tuple[tuple[object, ...], ...] = (
        ("export", path, "--out", path.with_name("out.jsonl")),
        ("report", path, "--no-videos", "--out", path.with_name("out.html")),
        ("replay", path, "nosuch"),
    )
    if rng.random() < 0.25:
        command(*commands[int(rng.integers(len(commands)))])


STORED: dict[str, tuple[Reader, int]] = {
    "corpora": (corpus, 2000),
    "store rows": (store_rows, 2000),
    "store bytes": (store_bytes, 1500),
}
"""As ``READERS``."""
