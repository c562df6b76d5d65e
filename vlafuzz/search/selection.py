"""Selection: lets any strategy choose from a fixed pool of scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vlafuzz.scene import Scene
from vlafuzz.scoring import Score
from vlafuzz.search.base import Genome, Proposal, Source, about
from vlafuzz.search.registry import Factory
from vlafuzz.space.params import Gene


class Selection:
    """Proposes the scenes of a pool, each once: always the nearest one to what a strategy proposes.

    Distance is that of the scene embedding. The strategy sees a space that consists of the unused scenes,
    each as its nearest genome, and receives the score of the scene that was taken. A genome proposed here is
    a scene's index, as in ``Pool``.

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
        """The strategy's own description, and the size of the pool."""
        description, size = about(self._strategy), len(self._left.genomes)
        return f"{description}, from a pool of {size}" if description else f"from a pool of {size}"

    def ask(self, n: int) -> list[Proposal]:
        """The nearest unused scenes, fewer at the end of the pool."""
        wanted = self._strategy.ask(min(n, int(self._left.unused.sum())))
        return [
            Proposal(proposal.id, np.array([self._left.take(proposal.genome)], dtype=float))
            for proposal in wanted
        ]

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
        self._space = space
        self.genomes = [space.nearest(scene) for scene in scenes]
        self._scenes = [space.decode(genome) for genome in self.genomes]
        self._points = np.array([space.embed(scene) for scene in self._scenes])
        self.unused = np.ones(len(scenes), dtype=bool)

    def take(self, genome: Genome) -> int:
        """Mark the nearest scene as used; return its index."""
        index = self._nearest(self._space.decode(genome))
        self.unused[index] = False
        return index

    @property
    def genes(self) -> Sequence[Gene]:
        """See ``Source``."""
        return self._space.genes

    @property
    def dim(self) -> int:
        """See ``Source``."""
        return self._space.dim

    def sample(self, rng: np.random.Generator) -> Scene:
        """A random unused scene; any scene when all are used."""
        left = np.flatnonzero(self.unused)
        return self._scenes[int(rng.choice(left)) if len(left) else int(rng.integers(len(self._scenes)))]

    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        """The nearest unused scene."""
        return self._scenes[self._nearest(scene)]

    def encode(self, scene: Scene) -> Genome:
        """See ``Source``."""
        return self._space.encode(scene)

    def decode(self, genome: Genome) -> Scene:
        """See ``Source``."""
        return self._space.decode(genome)

    def nearest(self, scene: Scene) -> Genome:
        """See ``Source``."""
        return self._space.nearest(scene)

    def embed(self, scene: Scene) -> NDArray[np.float64]:
        """See ``Source``."""
        return self._space.embed(scene)

    def site(self, scene: Scene, severities: Mapping[str, float]) -> str:
        """The scene's digest: in a pool every scene is a site of its own."""
        return scene.digest

    def severity(self, scene: Scene) -> float:
        """See ``Measure``."""
        return self._space.severity(scene)

    def severities(self, scene: Scene) -> Mapping[str, float]:
        """See ``Measure``."""
        return self._space.severities(scene)

    def _nearest(self, scene: Scene) -> int:
        distances = np.linalg.norm(self._points - self._space.embed(scene), axis=1)
        return int(np.argmin(np.where(self.unused, distances, np.inf)))
