"""A fixed pool of scenes in place of a search space: in order, or chosen by any strategy."""

from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np

from vlafuzz.errors import UsageError
from vlafuzz.model.scene import Scene
from vlafuzz.search.base import Genome, Proposal, Source, about, looks_for_causes
from vlafuzz.search.proposals import UNLIMITED
from vlafuzz.search.registry import Factory
from vlafuzz.search.scoring import Measure, Score


class Pool:
    """Scenes from a file: a genome is a scene's index, not in [0, 1]."""

    dim = 1

    def __init__(self, scenes: Sequence[Scene], measure: Measure) -> None:
        self.scenes = tuple(scenes)
        self.severity, self.severities = measure.severity, measure.severities
        self.groups, self.site = measure.groups, measure.site

    def decode(self, genome: Genome) -> Scene:
        return self.scenes[int(genome[0])]


class InOrder:
    """Proposes the scenes of a pool in order, each once."""

    outstanding = UNLIMITED

    def __init__(self, size: int) -> None:
        self._size, self._asked = size, 0

    def ask(self, n: int) -> list[Proposal]:
        """The next ``n`` scenes, fewer at the end."""
        first, self._asked = self._asked, min(self._asked + n, self._size)
        return [Proposal(index, np.array([index], dtype=np.float64)) for index in range(first, self._asked)]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Scores change nothing."""


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
        self._strategy = make(self._left, seed, budget)

    @property
    def about(self) -> str:
        """The strategy's own description, the size of the pool, and why there are no causes."""
        own, pool = about(self._strategy), f"from a pool of {len(self._left.genomes)}"
        if looks_for_causes(self._strategy):
            pool += "; no list of causes, for which it would have to vary scenes"
        return ", ".join(filter(None, (own, pool)))

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
