"""Replay: published labels of real VLAs as the oracle; strategies choose among scenes that were run before.

VLATest (FSE 2025) published which of its generated scenes each VLA passed. A strategy searches for either outcome: the
failures, or the *rare* outcome, which for these VLAs is a pass.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Self, cast

import numpy as np

from vlafuzz.errors import SceneError, UsageError
from vlafuzz.model.outcome import Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.registry import Factory, strategy_factory
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


class Selection:
    """Proposes the scenes of a pool, each once: always the nearest one to what a strategy proposes.

    Distance is that of the scene embedding. The strategy sees a space that consists of the unused scenes, each as its
    nearest genome, and receives the score of the scene that was taken. A genome proposed here is a scene's index, as in
    ``Pool``.

    Raises:
        SceneError: a scene has a value that no operator gives.
    """

    def __init__(
        self, make: Factory, space: Source, scenes: Sequence[Scene], seed: int, budget: int | None = None
    ) -> None:
        self._left = Left(space, scenes)
        self._strategy = make(cast(Source, self._left), seed, budget)

    def ask(self, n: int) -> list[Proposal]:
        """The nearest unused scenes, fewer at the end of the pool."""
        wanted = self._strategy.ask(min(n, int(self._left.unused.sum())))
        return [Proposal(proposal.id, np.array([self._left.take(proposal.genome)], dtype=float)) for proposal in wanted]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Pass the scores on, as if the strategy had proposed the scenes that were taken."""
        taken = [Proposal(proposal.id, self._left.genomes[int(proposal.genome[0])]) for proposal in proposals]
        self._strategy.tell(taken, scores)


class Left:
    """The unused scenes of a pool as a ``Source``, which yields no others.

    Attributes:
        genomes: the nearest genome of each scene, by index.
        unused: ``(n,)`` which scenes are left.
    """

    def __init__(self, space: Source, scenes: Sequence[Scene]) -> None:
        self.genes, self.dim = space.genes, space.dim
        self.encode, self.decode, self.nearest = space.encode, space.decode, space.nearest
        self.embed, self.severity, self.severities = space.embed, space.severity, space.severities
        self.groups = space.groups
        self.genomes = [space.nearest(scene) for scene in scenes]
        self._scenes = [space.decode(genome) for genome in self.genomes]
        self._points = np.array([space.embed(scene) for scene in self._scenes])
        self.unused = np.ones(len(scenes), dtype=bool)

    def take(self, genome: Genome) -> int:
        """Mark the nearest scene as used; return its index."""
        index = self._nearest_unused(self.decode(genome))
        self.unused[index] = False
        return index

    def sample(self, rng: np.random.Generator) -> Scene:
        """A random unused scene; any scene when all are used."""
        left = np.flatnonzero(self.unused)
        return self._scenes[int(rng.choice(left)) if len(left) else int(rng.integers(len(self._scenes)))]

    def narrowed(self, severity: float) -> Self:
        """Raise a UsageError: the scenes of a file have no ranges."""
        raise UsageError("strategy severity: the scenes of a pool have no ranges", hint="leave the pool out")

    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        """The nearest unused scene."""
        return self._scenes[self._nearest_unused(scene)]

    def site(self, scene: Scene, severities: Mapping[str, float]) -> str:
        """The scene's digest: in a pool every scene is a site of its own."""
        return scene.digest

    def _nearest_unused(self, scene: Scene) -> int:
        distances = np.linalg.norm(self._points - self.embed(scene), axis=1)
        return int(np.argmin(np.where(self.unused, distances, np.inf)))
