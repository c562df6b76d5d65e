"""The store's schema, as the steps that lead to it. A released step is never changed: add the next one."""

import sqlite3
from contextlib import closing
from functools import cache

# The oldest version whose stores are still opened wrote this schema.
_SCHEMA = (
    """
    CREATE TABLE run (
        id INTEGER PRIMARY KEY,
        task TEXT NOT NULL,
        policy TEXT NOT NULL,
        policy_key TEXT NOT NULL,
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
        seconds REAL,
        search_seconds REAL,
        store_seconds REAL,
        packs TEXT NOT NULL DEFAULT '[]',
        robot TEXT NOT NULL DEFAULT 'panda',
        checkup TEXT NOT NULL DEFAULT '',
        placement TEXT NOT NULL DEFAULT 'resting',
        scene_file TEXT NOT NULL DEFAULT '',
        source TEXT NOT NULL DEFAULT '',
        visible TEXT NOT NULL DEFAULT '',
        place TEXT NOT NULL DEFAULT '',
        label TEXT NOT NULL DEFAULT ''
    ) STRICT
    """,
    "CREATE TABLE scene (digest TEXT PRIMARY KEY, json TEXT NOT NULL) STRICT",
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
        policy_key TEXT NOT NULL,
        run INTEGER NOT NULL REFERENCES run,
        trial INTEGER NOT NULL REFERENCES trial,
        cell TEXT NOT NULL,
        UNIQUE (scene, policy_key)
    ) STRICT
    """,
    # Lists of operators, counterparts by operator, and thresholds are JSON.
    """
    CREATE TABLE triage (
        scene TEXT NOT NULL REFERENCES scene,
        policy_key TEXT NOT NULL,
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
        signature TEXT,
        witness_actions BLOB,
        witness_hash TEXT,
        witness_grasp INTEGER,
        shrink_rollouts INTEGER NOT NULL,
        policy_rollouts INTEGER NOT NULL,
        expert_rollouts INTEGER NOT NULL,
        seconds REAL NOT NULL,
        ended TEXT NOT NULL,
        bucket TEXT NOT NULL DEFAULT 'flaky'
            CHECK (bucket IN ('minimal', 'witnessed', 'base', 'unproven', 'edge', 'flaky')),
        rate TEXT NOT NULL DEFAULT 'null',
        certified TEXT NOT NULL DEFAULT 'null',
        counterpart_rates TEXT NOT NULL DEFAULT '{}',
        reference TEXT REFERENCES scene,
        witness_solver TEXT,
        PRIMARY KEY (scene, policy_key)
    ) STRICT
    """,
    # A run that looks for causes has one row in ``attribution``, and one in ``cause`` for each of them.
    """
    CREATE TABLE attribution (
        run INTEGER PRIMARY KEY REFERENCES run,
        unexplained INTEGER NOT NULL,
        probability REAL,
        low REAL,
        high REAL,
        at_random TEXT NOT NULL DEFAULT '[]'
    ) STRICT
    """,
    """
    CREATE TABLE cause (
        run INTEGER NOT NULL REFERENCES attribution,
        rank INTEGER NOT NULL,
        scene TEXT REFERENCES scene,
        operators TEXT NOT NULL,
        failures INTEGER NOT NULL,
        share REAL,
        low REAL,
        high REAL,
        PRIMARY KEY (run, rank)
    ) STRICT
    """,
    # The expert's, as demonstrations; without an attempt where none solves the scene.
    """
    CREATE TABLE solution (
        scene TEXT NOT NULL REFERENCES scene,
        "key" TEXT NOT NULL,
        attempt INTEGER,
        width INTEGER NOT NULL,
        actions BLOB NOT NULL,
        PRIMARY KEY (scene, "key")
    ) STRICT
    """,
    # Rollouts of a triage that was interrupted, for the next one that is made in the same way.
    """
    CREATE TABLE repeat (
        run INTEGER NOT NULL REFERENCES run,
        made TEXT NOT NULL,
        scene TEXT NOT NULL,
        number INTEGER NOT NULL,
        verdict TEXT NOT NULL,
        lost TEXT,
        rollouts INTEGER NOT NULL,
        PRIMARY KEY (run, made, scene, number)
    ) STRICT
    """,
)

# The statements that lead to each number of the schema. Lower numbers were never released.
STEPS: dict[int, tuple[str, ...]] = {
    17: _SCHEMA,
    # Earlier runs had no other settings of worlds, and all actions seven numbers.
    18: ("ALTER TABLE run ADD COLUMN world TEXT NOT NULL DEFAULT '{}'",),
    19: ("ALTER TABLE triage ADD COLUMN witness_width INTEGER",),
    # JSON; no cause of an earlier run was one of several that act through one quantity.
    20: ("ALTER TABLE cause ADD COLUMN mechanism TEXT NOT NULL DEFAULT 'null'",),
    # What fails exactly as it is, but not around, is not told apart any more.
    21: ("UPDATE triage SET bucket = 'flaky' WHERE bucket = 'edge'",),
    # What fails at nominal, too, is not shown to have a cause.
    22: ("UPDATE triage SET bucket = 'flaky', shrunk = NULL, signature = NULL WHERE bucket = 'base'",),
    # Success as in VLATest's environments is not judged any more.
    23: ("ALTER TABLE rollout DROP COLUMN published_success",),
    # JSON by name: levels of evidence that are younger than this step, and have no column of their own.
    24: ("ALTER TABLE triage ADD COLUMN more TEXT NOT NULL DEFAULT '{}'",),
    25: ("ALTER TABLE rollout ADD COLUMN recovery INTEGER",),
}


Shape = dict[str, tuple[object, ...]]  # of each table: whether it is one, strict and by row ids; its columns


def shape_of(connection: sqlite3.Connection) -> Shape:
    """The tables of a store that is open."""
    listed = connection.execute("SELECT name, type, wr, strict FROM pragma_table_list WHERE schema = 'main'")
    columns = "SELECT name, type, pk > 0 FROM pragma_table_info(?)"
    return {name: (*kind, frozenset(connection.execute(columns, (name,)))) for name, *kind in listed.fetchall()}


@cache
def shape_at(version: int) -> Shape:
    """The tables that a version of the schema has."""
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as fresh:
        for number, statements in STEPS.items():
            if number <= version:
                fresh.executescript(";".join(statements))
        return shape_of(fresh)


def migrate(connection: sqlite3.Connection, application_id: int) -> None:
    """Bring a store to the newest schema, each step in a transaction of its own."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    for number in range(max(version + 1, min(STEPS)), max(STEPS) + 1):
        connection.execute("BEGIN IMMEDIATE")
        with connection:
            for statement in STEPS[number]:
                connection.execute(statement)
            connection.execute(f"PRAGMA application_id = {application_id}")
            connection.execute(f"PRAGMA user_version = {number}")
