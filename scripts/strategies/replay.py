"""Replay: published labels of real VLAs as oracle; strategies choose among scenes that were run before.

VLATest (FSE 2025) published which of its generated scenes each VLA passed. Wanted is either outcome: the
failures, and the *rare* one, which for these VLAs are the passes.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from vlafuzz.errors import SceneError
from vlafuzz.formats.vlatest.read import read_vlatest
from vlafuzz.objects import load_catalogue
from vlafuzz.outcome import Verdict
from vlafuzz.scene import Scene
from vlafuzz.scoring import Score
from vlafuzz.search.registry import strategy_factory
from vlafuzz.search.selection import Selection
from vlafuzz.space import SearchSpace, load_operators

LABELS = "all-correct-task.json"
LEAST = 50  # passes that a VLA has, to be looked at
BATCH = 16
HIT = Score(Verdict.FAILED, progress=0.0, severity=0.0)  # nothing but the label is known
MISS = Score(Verdict.PASSED, progress=1.0, severity=0.0)


@dataclass(frozen=True)
class Labels:
    """What a VLA passed of a file of scenes; ``rare`` when that is what is wanted, else the failures."""

    folder: Path
    file: str
    model: str
    passed: tuple[int, ...]
    rare: bool

    @property
    def name(self) -> str:
        return f"{self.model} on {self.file}: {'passes' if self.rare else 'failures'}"

    def most(self, budget: int) -> int:
        """That any strategy can find."""
        there = len(self.passed) if self.rare else len(_scenes(self.folder / self.file)) - len(self.passed)
        return min(budget, there)

    def play(self, strategy: str, seed: int, budget: int) -> dict[str, float]:
        scenes = _scenes(self.folder / self.file)
        passed = np.isin(np.arange(len(scenes)), self.passed)
        wanted = passed if self.rare else ~passed
        space = _space(scenes[0].task)
        selection = Selection(strategy_factory(strategy), space, scenes, seed, budget)
        found = spent = 0
        while spent < budget:
            proposals = selection.ask(min(BATCH, budget - spent))
            if not proposals:
                break
            hits = [bool(wanted[int(proposal.genome[0])]) for proposal in proposals]
            selection.tell(proposals, [HIT if hit else MISS for hit in hits])
            found, spent = found + sum(hits), spent + len(hits)
        return {"found": found}


def cases(folder: Path) -> list[Labels]:
    """Every VLA and file with enough passes, and both outcomes of each.

    Raises:
        SceneError: the folder has no such labels.
    """
    path = folder / LABELS
    try:
        labels = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SceneError(f"{path}: cannot be read: {error}", "name VLATest's folder `data`") from None
    return [
        Labels(folder, f"{file}.json", model, tuple(passed), rare)
        for file, models in labels.items()
        for model, passed in models.items()
        for rare in (False, True)
        if len(passed) >= LEAST
    ]


@cache
def _scenes(path: Path) -> tuple[Scene, ...]:
    read = read_vlatest(path, load_catalogue())
    assert not read.missing, f"{path}: labels go by index, and scenes are left out: {read.missing}"
    return read.scenes


@cache
def _space(task: str) -> SearchSpace:
    return SearchSpace(load_operators(), load_catalogue(), task)
