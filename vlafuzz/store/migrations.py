"""The store's schema, as the steps that lead to it. A released step is never changed: add the next one."""

import sqlite3
from pathlib import Path

# The statements that lead to each number of the schema. Lower numbers were never released.
STEPS: dict[int, tuple[str, ...]] = {
    17: tuple(Path(__file__).with_name("schema.sql").read_text(encoding="utf-8").strip().removesuffix(";").split(";")),
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
    # A finding whose triage is interrupted begins anew.
    26: ("DROP TABLE repeat",),
    # JSON: outcomes by operator.
    27: ("ALTER TABLE cause ADD COLUMN tests TEXT NOT NULL DEFAULT '{}'",),
}


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
