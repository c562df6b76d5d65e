"""Shown: the expert's demonstrations of the arms' scenes, as make_demos.py writes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from make_demos import Demonstrator
from mini_data import write

from repair.arms import Kind, wanted
from vlafuzz.exports.selection import WantedScene
from vlafuzz.model import Verdict
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.store.records import Manifest
from vlafuzz.worlds.evaluator import SceneEvaluator

SPARE = 3  # scenes for each demonstration: some are not fair, and some the expert does not solve
JOB = 10  # demonstrations, in a folder of their own


@dataclass(frozen=True)
class Job:
    """Demonstrations in the first scenes that allow it; ``first``: number of its first scene."""

    scenes: Sequence[WantedScene]
    first: int
    driver: Path | None
    out: Path

    def run(self) -> int:
        """Number of demonstrations written."""
        steps: list[dict[str, Any]] = []
        written = 0
        for number, one in enumerate(self.scenes, start=self.first):
            demonstrator, evaluator = _pair(one.run, self.driver)
            evaluator.seed = number
            (outcome,) = evaluator.evaluate([one.scene])
            if outcome.verdict is Verdict.PASSED and any(step["taught"] for step in demonstrator.steps):
                steps += [step | {"episode": number} for step in demonstrator.steps]
                written += 1
            if written == JOB:
                break
        if steps:
            write(steps, self.out)
        return written


_pairs: dict[tuple[str, str, Path | None], tuple[Demonstrator, SceneEvaluator]] = {}  # of this process


def _pair(run: Manifest, driver: Path | None) -> tuple[Demonstrator, SceneEvaluator]:
    key = run.task, run.key(seeded=False), driver
    if key not in _pairs:
        once, demonstrator = replace(run, repeats=1, stop_early=True), Demonstrator(driver)
        _pairs[key] = demonstrator, make_evaluator(once, demonstrator)
    return _pairs[key]


def jobs(store: Path, task: str, kind: Kind, number: int, driver: Path, out: Path) -> list[Job]:
    """Jobs for that many demonstrations in scenes of one kind, each with a folder in ``out``."""
    parts = -(-number // JOB)
    drawn = list(islice(wanted(store, task, kind), parts * JOB * SPARE))
    return [
        Job(
            drawn[part::parts], part * JOB * SPARE, driver if kind == "taken-over" else None, out / f"{task}-{part:03d}"
        )
        for part in range(parts)
    ]


def parts_of(folder: Path, tasks: Sequence[str], number: int) -> list[Path]:
    """The folders of the first demonstrations of one kind, that many of each task."""
    return [part for task in tasks for part in sorted(folder.glob(f"{task}-*"))[: -(-number // JOB)]]
