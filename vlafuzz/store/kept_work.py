"""KeptWork: what a store keeps to save work: solutions of the expert, rollouts of an interrupted triage."""

import sqlite3

from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.store.database import intact
from vlafuzz.store.records import Judged, Repeats, Solution
from vlafuzz.store.rows import Row, check_counts, pack, unpack
from vlafuzz.store.sqlite_file import SqliteFile


class KeptWork(SqliteFile):
    """See ``Store``."""

    def keep_solution(self, key: str, scene: Scene, solution: Solution) -> None:
        """Store what the expert did in a scene, for demonstrations under conditions with this key."""
        with self._transaction():
            self._insert_scene(scene)
            self._insert("solution", _solution_row(scene, key, solution), "OR REPLACE")

    def solutions(self, key: str) -> dict[str, Solution]:
        """What ``keep_solution`` stored under a key, by the scene's digest."""
        with intact(self.path):
            selected = self._select("SELECT * FROM solution WHERE key = ?", key)
            return {row["scene"]: _to_solution(row) for row in selected}

    def keep_repeats(self, run: int, made: str, repeats: Repeats) -> None:
        """Store rollouts of a triage that was interrupted, in place of all earlier ones of the run.

        Args:
            made: where and with what; what was made otherwise says nothing.
        """
        with self._transaction():
            self._connection.execute("DELETE FROM repeat WHERE run = ?", (run,))
            for (scene, number), judged in repeats.items():
                self._insert("repeat", _repeat_row(run, made, scene, number, judged))

    def repeats(self, run: int, made: str) -> Repeats:
        """What ``keep_repeats`` stored of a run."""
        with intact(self.path):
            selected = self._select("SELECT * FROM repeat WHERE run = ? AND made = ?", run, made)
            return {(row["scene"], row["number"]): _to_repeat(row) for row in selected}

    def _insert_scene(self, scene: Scene) -> None:
        self._insert("scene", {"digest": scene.digest, "json": scene.to_json()}, "OR IGNORE")


def _solution_row(scene: Scene, key: str, solution: Solution) -> Row:
    """Columns of ``solution``."""
    actions = solution.actions
    kept = {"attempt": solution.attempt, "width": actions.shape[1], "actions": pack(actions)}
    return {"scene": scene.digest, "key": key} | kept


def _to_solution(row: sqlite3.Row) -> Solution:
    """The inverse of ``_solution_row``."""
    check_counts(row)
    return Solution(row["attempt"], unpack(row["actions"], -1, max(row["width"], 1)))


def _repeat_row(run: int, made: str, scene: str, number: int, judged: Judged) -> Row:
    """Columns of ``repeat``."""
    key = {"run": run, "made": made, "scene": scene, "number": number}
    return key | {"verdict": judged.verdict.name.lower(), "lost": judged.lost, "rollouts": judged.rollouts}


def _to_repeat(row: sqlite3.Row) -> Judged:
    """The inverse of ``_repeat_row``."""
    check_counts(row)
    return Judged(Verdict[row["verdict"].upper()], row["lost"], row["rollouts"])
