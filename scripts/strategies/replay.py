"""Replay: published labels of real VLAs as the oracle; strategies choose among scenes that were run before.

VLATest (FSE 2025) published which of its generated scenes each VLA passed. A strategy searches for either outcome: the
failures, or the *rare* outcome, which for these VLAs is a pass.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from vlafuzz.errors import SceneError
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.search.pool import Selection
from vlafuzz.search.registry import strategy_factory
from vlafuzz.search.scoring import Score
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.vlatest import read_vlatest

LABELS = "all-correct-task.json"
LEAST = 50  # passes of a VLA, to be included
BATCH = 16
HIT = Score(Verdict.FAILED, progress=0.0, severity=0.0)  # only the label is known
MISS = Score(Verdict.PASSED, progress=1.0, severity=0.0)


@dataclass(frozen=True)
class Labels:
    """The scenes of a file that a VLA passed; ``rare``: search for these, else for the failures."""

    folder: Path
    file: str
    model: str
    passed: tuple[int, ...]
    rare: bool

    @property
    def name(self) -> str:
        return f"{self.model} on {self.file}: {'passes' if self.rare else 'failures'}"

    def most(self, budget: int) -> int:
        """The most that any strategy can find."""
        passes, scenes = len(self.passed), len(_scenes(self.folder / self.file))
        return min(budget, passes if self.rare else scenes - passes)

    def play(self, strategy: str, seed: int, budget: int) -> dict[str, float]:
        scenes = _scenes(self.folder / self.file)
        passed = np.isin(np.arange(len(scenes)), self.passed)
        wanted = passed if self.rare else ~passed
        space = _space(scenes[0].task)
        selection = Selection(strategy_factory(strategy), space, scenes, seed, budget)
        hit_count = spent = 0
        while spent < budget:
            proposals = selection.ask(min(BATCH, budget - spent))
            if not proposals:
                break
            hits = [bool(wanted[int(proposal.genome[0])]) for proposal in proposals]
            selection.tell(proposals, [HIT if hit else MISS for hit in hits])
            hit_count, spent = hit_count + sum(hits), spent + len(hits)
        return {"found": hit_count}


def cases(folder: Path) -> list[Labels]:
    """Every VLA and file with enough passes, for both outcomes.

    Raises:
        SceneError: the folder has no labels.
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
    imported = read_vlatest(path, load_catalogue())
    assert not imported.missing, f"{path}: labels go by index, and scenes are left out: {imported.missing}"
    return imported.scenes


@cache
def _space(task: str) -> SearchSpace:
    return SearchSpace(load_operators(), load_catalogue(), task)
