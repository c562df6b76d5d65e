"""Store: runs, trials and findings in one SQLite file, with one writer."""

import json
import sqlite3
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, Self, TypeVar

from vlafuzz.errors import StoreError
from vlafuzz.model import Outcome, Rollout, Scene, Verdict
from vlafuzz.store import rows
from vlafuzz.store.database import WriterLock, connect_to_read, connect_to_write, explained, gather, intact, is_outdated
from vlafuzz.store.records import UNFINISHED, Attribution, Finding, Manifest, Run, Status, Triaged, Trial

T = TypeVar("T")
_SHOWN = 5  # digests, when a prefix fits several
UNSURE = 1.0  # seconds of writing that a power cut may lose; waiting for the disk each time takes a quarter of a write


class Store:
    """An open store; without a lock it is only read.

    Whatever a method has written when it returns outlives this process; a power cut loses at most ``UNSURE`` of it.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: WriterLock | None) -> None:
        self.path, self._connection, self._lock = path, connection, lock
        self._synced = -UNSURE
        connection.row_factory = sqlite3.Row

    @classmethod
    def open(cls, path: Path, mode: Literal["read", "write"] = "read") -> Self:
        """Open a store; in mode ``write``, create it if it is missing.

        Raises:
            StoreError: it is missing, no store, damaged, newer than this vlafuzz, or being written.
        """
        path = Path(path)
        if mode == "write":
            return cls._open_to_write(path)
        with explained(path):
            connection = connect_to_read(path)
            if is_outdated(connection):
                connection.close()
                cls._open_to_write(path).close()
                connection = connect_to_read(path)
            return cls(path, connection, None)

    @classmethod
    def _open_to_write(cls, path: Path) -> Self:
        lock = WriterLock(path)
        try:
            with explained(path):
                return cls(path, connect_to_write(path), lock)
        except BaseException:
            lock.release()
            raise

    def close(self) -> None:
        """Let others write. Without it nothing is lost."""
        if self._lock is not None:
            gather(self._connection)
        self._connection.close()
        if self._lock is not None:
            self._lock.release()
            self._lock = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # writing

    def begin(self, manifest: Manifest) -> int:
        """Add a run; returns its id."""
        with self._transaction():
            return self._insert("run", rows.run_row(manifest) | {"started": _now()})

    def reopen(self, run: int, *, finished: bool = False) -> float:
        """Continue a run that ended early, or also one that is ``finished``; returns the seconds that it has taken.

        Its last errors, after which no scene was judged, are forgotten and so tried again.
        """
        rolling = "coalesce(seconds, (SELECT total(seconds) FROM trial WHERE run = ?1))"  # if it was killed
        query = f"SELECT {rolling} FROM run WHERE id = ?1"
        with self._transaction():
            reopened = self._connection.execute(
                f"UPDATE run SET status = 'running', ended = NULL WHERE id = ?1 AND (?2 OR status IN {UNFINISHED})",
                (run, finished),
            )
            if not reopened.rowcount:
                raise StoreError(f"{self.path}: run {run} is over", hint="leave out --resume for a new run")
            judged = "SELECT max(id) FROM trial WHERE run = ?1 AND verdict IN ('passed', 'failed')"
            last = f"SELECT id FROM trial WHERE run = ?1 AND id > coalesce(({judged}), 0)"
            for table, column in (("rollout", "trial"), ("trial", "id")):
                self._connection.execute(f"DELETE FROM {table} WHERE {column} IN ({last})", (run,))
            return float(self._connection.execute(query, (run,)).fetchone()[0])

    def add(self, run: int, trial: Trial) -> None:
        """Store a trial with its rollouts, and as a finding when it failed: all of it or nothing."""
        with self._transaction():
            self._insert_scene(trial.scene)
            number = self._insert("trial", rows.trial_row(run, trial))
            for index, rollout in enumerate(() if trial.duplicate else trial.outcome.rollouts):
                self._insert("rollout", rows.rollout_row(number, index, rollout))
            if trial.outcome.verdict is Verdict.FAILED:
                (key,) = self._connection.execute("SELECT policy_key FROM run WHERE id = ?", (run,)).fetchone()
                row = {"scene": trial.scene.digest, "policy_key": key, "run": run, "trial": number}
                self._insert("finding", row | {"cell": trial.cell or ""}, "OR IGNORE")

    def settle(self, triaged: Triaged) -> None:
        """Store a triaged finding with all its scenes; it replaces an earlier result."""
        with self._transaction():
            for scene in (triaged.shrunk, triaged.reference, *triaged.counterparts.values()):
                if scene is not None:
                    self._insert_scene(scene)
            self._insert("triage", rows.triage_row(triaged) | {"ended": _now()}, "OR REPLACE")

    def keep_causes(self, run: int, found: Attribution) -> None:
        """Store the causes that a run has found; they replace earlier ones."""
        with self._transaction():
            for table in ("cause", "attribution"):
                self._connection.execute(f"DELETE FROM {table} WHERE run = ?", (run,))
            self._insert("attribution", rows.attribution_row(run, found))
            for rank, cause in enumerate(found.causes, start=1):
                self._insert("cause", rows.cause_row(run, rank, cause))

    def finish(self, run: int, status: Status, seconds: float) -> None:
        """Mark a run as over, with its wall time."""
        query = "UPDATE run SET status = ?, ended = ?, seconds = ? WHERE id = ?"
        with self._transaction():
            self._connection.execute(query, (status, _now(), seconds, run))

    # reading

    def runs(self) -> list[Run]:
        """All runs, the oldest first."""
        return self._all(rows.to_run, "SELECT * FROM run ORDER BY id")

    def trials(self, run: int) -> Iterator[Trial]:
        """The trials of a run, in the order of its proposals."""
        self._require(run)
        query = "SELECT trial.*, json FROM trial JOIN scene ON digest = scene WHERE run = ? ORDER BY proposal"
        for row in self._select(query, run):
            with intact(self.path):
                trial = rows.to_trial(row, self._rollouts(row["id"]))
            yield trial

    def outcomes_by_scene(self, run: int) -> list[tuple[Scene, bool]]:
        """The scenes that passed or failed in a run, each once, and whether the policy failed."""
        query = (
            "SELECT scene.*, max(verdict = 'failed') AS failed FROM scene JOIN trial ON trial.scene = scene.digest"
            " WHERE run = ? AND verdict IN ('passed', 'failed') GROUP BY digest ORDER BY digest"
        )
        return self._all(lambda row: (rows.to_scene(row), bool(row["failed"])), query, run)

    def extent(self, run: int) -> tuple[int, int]:
        """Number of trials of a run, and the largest id of a proposal among them, -1 without any."""
        query = "SELECT count(*), coalesce(max(proposal), -1) FROM trial WHERE run = ?"
        ((trials, last),) = self._select(query, run)
        return trials, last

    def rollouts(self, run: int) -> int:
        """Number of rollouts of a run, without those that another run had made."""
        query = "SELECT count(*) FROM rollout JOIN trial ON trial.id = trial WHERE run = ?"
        return int(self._select(query, run)[0][0])

    def judged(self, runs: Sequence[int]) -> tuple[int, int]:
        """Number of scenes of some runs that failed, and that failed or passed, by their last verdict."""
        query = (
            "SELECT total(verdict = 'failed') AS failed, count(*) AS judged FROM"
            " (SELECT verdict, max(id) FROM trial WHERE verdict IN ('passed', 'failed')"
            " AND run IN (SELECT value FROM json_each(?)) GROUP BY scene)"
        )
        (row,) = self._select(query, json.dumps(list(runs)))
        return int(row["failed"]), int(row["judged"])

    def stored(self, run: int, first: int, size: int) -> list[Trial]:
        """The trials of ``size`` proposals of a run from ``first`` on, in the order in which they were added.

        Their outcomes are those that the strategy was told: a duplicate has the rollouts that answered it.
        """
        source = (
            "SELECT max(source.id) FROM trial AS source JOIN run ON run.id = source.run"
            " WHERE source.scene = trial.scene AND NOT source.duplicate AND source.id <= trial.id"
        )
        own = f"{source} AND source.run = trial.run"
        other = f"{source} AND policy_key = (SELECT policy_key FROM run WHERE id = trial.run)"
        query = (
            f"SELECT trial.*, json, iif(duplicate, coalesce(({own}), ({other})), id) AS origin FROM trial"
            " JOIN scene ON digest = scene WHERE run = ? AND proposal >= ? AND proposal < ? ORDER BY id"
        )
        return self._all(lambda row: rows.to_trial(row, self._rollouts(row["origin"])), query, run, first, first + size)

    def findings(self, run: int | None = None) -> list[Finding]:
        """All findings, or those that failed in one run whichever run saw them first; in the order of proposals.

        That is not the order of completion, which differs with several workers: triage uses what it has learnt from
        the findings before.
        """
        own = () if run is None else (run,)
        if run is not None:
            self._require(run)
        seen = (
            "WHERE EXISTS (SELECT 1 FROM trial AS seen JOIN run ON run.id = seen.run WHERE run.id = ?"
            " AND seen.verdict = 'failed' AND seen.scene = finding.scene AND run.policy_key = finding.policy_key)"
        )
        query = (
            "SELECT finding.*, json FROM finding JOIN scene ON digest = finding.scene"
            f" JOIN trial ON trial.id = finding.trial {seen * len(own)} ORDER BY finding.run, proposal"
        )
        return self._all(
            lambda row: Finding(rows.to_scene(row, "scene"), row["policy_key"], row["run"], row["cell"]), query, *own
        )

    def causes(self, run: int) -> Attribution | None:
        """The causes that a run has found; None if its strategy does not look for causes."""
        self._require(run)
        query = "SELECT * FROM cause LEFT JOIN scene ON digest = scene WHERE run = ? ORDER BY rank"
        for row in self._select("SELECT * FROM attribution WHERE run = ?", run):
            with intact(self.path):
                return rows.to_attribution(row, self._select(query, run))
        return None

    def triaged(self) -> list[Triaged]:
        """All triaged findings, in the order in which they were triaged."""
        return self._all(lambda row: rows.to_triaged(row, self._scene), "SELECT * FROM triage ORDER BY rowid")

    def known(self, scene: Scene, policy_key: str, run: int | None = None) -> Outcome | None:
        """The outcome of a scene under a policy key; None when it has to be tried (again).

        An ERROR says nothing about the scene and does not count. Only failing rollouts have their actions.

        Args:
            run: only rollouts of this run; by default of any run.
        """
        own = () if run is None else (run,)
        query = (
            "SELECT trial.* FROM trial JOIN run ON run.id = run WHERE scene = ? AND policy_key = ?"
            f"{' AND run.id = ?' * len(own)}"
            " AND NOT duplicate AND verdict != 'error' ORDER BY trial.id DESC LIMIT 1"
        )
        known = self._all(
            lambda row: rows.to_outcome(row, self._rollouts(row["id"])), query, scene.digest, policy_key, *own
        )
        return next(iter(known), None)

    def scene(self, prefix: str) -> Scene:
        """The scene whose digest begins with a prefix; a StoreError if none does, or several do."""
        prefix = prefix.lower()
        query = "SELECT * FROM scene WHERE substr(digest, 1, length(?1)) = ?1 ORDER BY digest LIMIT ?2"
        matches = self._select(query, prefix, _SHOWN)
        if not matches:
            hint = f"`vlafuzz report {self.path}` lists the findings"
            raise StoreError(f"{self.path}: no scene {prefix!r}", hint=hint)
        if len(matches) > 1:
            hint = "give more digits: " + ", ".join(row["digest"] for row in matches)
            raise StoreError(f"{self.path}: {prefix!r} fits several scenes", hint=hint)
        with intact(self.path):
            return rows.to_scene(matches[0])

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        assert self._lock is not None, "open the store to write"
        with explained(self.path):
            due = time.monotonic() >= self._synced + UNSURE
            self._connection.execute(f"PRAGMA synchronous = {'FULL' if due else 'NORMAL'}")
            self._connection.execute("BEGIN IMMEDIATE")
            with self._connection:
                yield
            self._synced = time.monotonic() if due else self._synced

    def _insert(self, table: str, row: rows.Row, conflict: str = "") -> int:
        names = ", ".join(f'"{name}"' for name in row)
        marks = ", ".join(f":{name}" for name in row)
        done = self._connection.execute(f"INSERT {conflict} INTO {table} ({names}) VALUES ({marks})", row)
        return int(done.lastrowid or 0)

    def _all(self, made: Callable[[sqlite3.Row], T], query: str, *values: str | int) -> list[T]:
        with intact(self.path):
            return [made(row) for row in self._select(query, *values)]

    def _select(self, query: str, *values: str | int) -> list[sqlite3.Row]:
        with explained(self.path):
            return self._connection.execute(query, values).fetchall()

    def _insert_scene(self, scene: Scene) -> None:
        self._insert("scene", {"digest": scene.digest, "json": scene.to_json()}, "OR IGNORE")

    def _scene(self, digest: str) -> Scene:
        for row in self._select("SELECT * FROM scene WHERE digest = ?", digest):
            return rows.to_scene(row)
        raise ValueError(f"there is no scene {digest}")

    def _rollouts(self, trial: int) -> tuple[Rollout, ...]:
        selected = self._select("SELECT * FROM rollout WHERE trial = ? ORDER BY number", trial)
        return tuple(map(rows.to_rollout, selected))

    def _require(self, run: int) -> None:
        known = [row["id"] for row in self._select("SELECT id FROM run ORDER BY id")]
        if run not in known:
            shown = ", ".join(map(str, known)) or "none yet"
            raise StoreError(f"{self.path}: no run {run}", hint=f"its runs: {shown}")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
