"""Small logs in the layouts of lerobot, vla-eval and CSV, made up."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vlafuzz.logs.episodes import LoggedEpisode


def episodes(**outcomes: str) -> list[LoggedEpisode]:
    """Episodes of suites by one letter each: ``s`` succeeds, ``f`` fails, ``e`` ended in an error."""
    verdicts = {"s": True, "f": False, "e": None}
    return [
        LoggedEpisode(suite=suite, task="t", state=str(number), place=f"{suite} {number}", success=verdicts[letter])
        for suite, letters in outcomes.items()
        for number, letter in enumerate(letters)
    ]


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return path


def suite_csv(path: Path, **outcomes: str) -> Path:
    """``episodes`` as CSV."""
    letters = {True: 1, False: 0, None: ""}
    return write_csv(
        path,
        [
            {"suite": one.suite, "task": one.task, "episode": one.state, "success": letters[one.success]}
            for one in episodes(**outcomes)
        ],
    )


def write_json(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path


VLA_EVAL = {
    "benchmark": "libero_goal",
    "harness_version": "0.3.0",
    "tasks": [
        {
            "task": "open the drawer",
            "episodes": [
                {"episode_id": 0, "metrics": {"success": True}, "steps": 90},
                {"episode_id": 1, "metrics": {"success": False}, "steps": 300},
                {"episode_id": 2, "metrics": {}, "failure_reason": "timeout"},
            ],
        }
    ],
}
LEROBOT = {"per_task": [{"task_group": "libero_goal", "task_id": 3, "metrics": {"successes": [True, False]}}]}
