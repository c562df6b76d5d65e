"""The store's schema, as the steps that lead to it. A released step is never changed: add the next one."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable

_FIRST = (
    """
    CREATE TABLE run (
        id INTEGER PRIMARY KEY,
        task TEXT NOT NULL,
        subject TEXT NOT NULL,
        subject_key TEXT NOT NULL,
        spec TEXT NOT NULL,
        strategy TEXT NOT NULL,
        budget INTEGER NOT NULL,
        batch INTEGER NOT NULL,
        seed INTEGER NOT NULL,
        repeats INTEGER NOT NULL,
        criteria TEXT NOT NULL,
        stop_early INTEGER NOT NULL,
        min_distance REAL NOT NULL,
        operators TEXT NOT NULL,
        operators_digest TEXT NOT NULL,
        catalogue_digest TEXT NOT NULL,
        simulator TEXT NOT NULL,
        versions TEXT NOT NULL,
        "commit" TEXT,
        command TEXT NOT NULL,
        status TEXT NOT NULL DEFAULT 'running'
            CHECK (status IN ('running', 'finished', 'stopped', 'interrupted', 'failed')),
        started TEXT NOT NULL,
        ended TEXT,
        seconds REAL
    ) STRICT
    """,
    """
    CREATE TABLE scene (
        digest TEXT PRIMARY KEY,
        json TEXT NOT NULL
    ) STRICT
    """,
    """
    CREATE TABLE trial (
        id INTEGER PRIMARY KEY,
        run INTEGER NOT NULL REFERENCES run,
        proposal INTEGER NOT NULL,
        scene TEXT NOT NULL REFERENCES scene,
        genome BLOB,
        verdict TEXT NOT NULL CHECK (verdict IN ('error', 'invalid', 'passed', 'failed')),
        progress REAL,
        severity REAL,
        lost_stage TEXT,
        cell TEXT,
        detail TEXT NOT NULL,
        check_name TEXT NOT NULL,
        duplicate INTEGER NOT NULL CHECK (duplicate IN (0, 1)),
        seconds REAL NOT NULL,
        UNIQUE (run, proposal)
    ) STRICT
    """,
    "CREATE INDEX trial_scene ON trial (scene)",
    """
    CREATE TABLE rollout (
        trial INTEGER NOT NULL REFERENCES trial,
        number INTEGER NOT NULL,
        success_once INTEGER NOT NULL CHECK (success_once IN (0, 1)),
        success_at_end INTEGER NOT NULL CHECK (success_at_end IN (0, 1)),
        published_success INTEGER NOT NULL CHECK (published_success IN (0, 1)),
        reached TEXT NOT NULL,
        progress REAL,
        steps INTEGER NOT NULL,
        trace BLOB NOT NULL,
        actions BLOB,
        states_hash TEXT NOT NULL,
        seconds REAL NOT NULL,
        PRIMARY KEY (trial, number)
    ) STRICT, WITHOUT ROWID
    """,
    """
    CREATE TABLE finding (
        id INTEGER PRIMARY KEY,
        scene TEXT NOT NULL REFERENCES scene,
        subject_key TEXT NOT NULL,
        run INTEGER NOT NULL REFERENCES run,
        trial INTEGER NOT NULL REFERENCES trial,
        evidence TEXT NOT NULL DEFAULT 'observed',
        cell TEXT NOT NULL,
        UNIQUE (scene, subject_key)
    ) STRICT
    """,
)


# Lists of operators, counterparts by operator, and thresholds are JSON.
_TRIAGE = """
    CREATE TABLE triage (
        scene TEXT NOT NULL REFERENCES scene,
        subject_key TEXT NOT NULL,
        bucket TEXT NOT NULL CHECK (bucket IN ('minimal', 'witnessed', 'base', 'unproven', 'flaky')),
        detail TEXT NOT NULL,
        repeats INTEGER NOT NULL,
        failures INTEGER NOT NULL,
        deviating TEXT NOT NULL,
        shrunk TEXT REFERENCES scene,
        lost_stage TEXT,
        operators TEXT NOT NULL,
        necessary TEXT NOT NULL,
        sufficient TEXT NOT NULL,
        thresholds TEXT NOT NULL,
        counterparts TEXT NOT NULL,
        unresolved TEXT NOT NULL,
        signature TEXT,
        witness_actions BLOB,
        witness_hash TEXT,
        witness_grasp INTEGER,
        complete INTEGER NOT NULL CHECK (complete IN (0, 1)),
        shrink_rollouts INTEGER NOT NULL,
        subject_rollouts INTEGER NOT NULL,
        expert_rollouts INTEGER NOT NULL,
        seconds REAL NOT NULL,
        ended TEXT NOT NULL,
        PRIMARY KEY (scene, subject_key)
    ) STRICT
    """


def _first(connection: sqlite3.Connection) -> None:
    for statement in _FIRST:
        connection.execute(statement)


def _triage(connection: sqlite3.Connection) -> None:
    connection.execute(_TRIAGE)


def _seconds_apart(connection: sqlite3.Connection) -> None:
    """Unknown for earlier runs."""
    for name in ("search_seconds", "store_seconds"):
        connection.execute(f"ALTER TABLE run ADD COLUMN {name} REAL")


def _packs(connection: sqlite3.Connection) -> None:
    """Earlier runs had no packs."""
    connection.execute("ALTER TABLE run ADD COLUMN packs TEXT NOT NULL DEFAULT '[]'")


def _robot(connection: sqlite3.Connection) -> None:
    """There was only one robot."""
    connection.execute("ALTER TABLE run ADD COLUMN robot TEXT NOT NULL DEFAULT 'panda'")


def _checkup(connection: sqlite3.Connection) -> None:
    """The policies of earlier runs were not checked."""
    connection.execute("ALTER TABLE run ADD COLUMN checkup TEXT NOT NULL DEFAULT ''")


def _placement(connection: sqlite3.Connection) -> None:
    """Earlier runs dropped no objects."""
    connection.execute("ALTER TABLE run ADD COLUMN placement TEXT NOT NULL DEFAULT 'resting'")


def _given(connection: sqlite3.Connection) -> None:
    """Unknown for earlier runs: their file of scenes, and the user's own code."""
    for name in ("given", "source"):
        connection.execute(f"ALTER TABLE run ADD COLUMN {name} TEXT NOT NULL DEFAULT ''")


RENAMED = (
    ("run", "subject", "policy"),
    ("run", "subject_key", "policy_key"),
    ("run", "given", "scene_file"),
    ("finding", "subject_key", "policy_key"),
    ("triage", "subject_key", "policy_key"),
    ("triage", "subject_rollouts", "policy_rollouts"),
)


def _policy(connection: sqlite3.Connection) -> None:
    """A policy was called a subject, and the file of scenes what was given."""
    for table, old, new in RENAMED:
        connection.execute(f"ALTER TABLE {table} RENAME COLUMN {old} TO {new}")


def _unread(connection: sqlite3.Connection) -> None:
    """These were written, but never read."""
    for table, name in (("finding", "evidence"), ("triage", "complete"), ("triage", "unresolved")):
        connection.execute(f"ALTER TABLE {table} DROP COLUMN {name}")


MIGRATIONS: list[Callable[[sqlite3.Connection], None]] = [
    _first,
    _triage,
    _seconds_apart,
    _packs,
    _robot,
    _checkup,
    _placement,
    _given,
    _policy,
    _unread,
]


def migrate(connection: sqlite3.Connection, application_id: int) -> None:
    """Bring a store to the newest schema, each step in a transaction of its own."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    for number, step in enumerate(MIGRATIONS[version:], start=version + 1):
        connection.execute("BEGIN IMMEDIATE")
        with connection:
            step(connection)
            connection.execute(f"PRAGMA application_id = {application_id}")
            connection.execute(f"PRAGMA user_version = {number}")
