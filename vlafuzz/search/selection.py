"""Selection: any strategy, made to choose from a fixed pool of scenes."""

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
    """Proposes scenes of a pool, each once, and ends with it: the nearest to what a strategy proposes.

    Near is what is alike in meaning. The strategy sees a space of nothing but what is left of the pool, each
    scene as the nearest one that has a genome, and is told of the one that was taken. A genome of ours is a
    scene's index, as in ``Pool``.

    Raises:
        SceneError: a scene has something that no operator gives.
    """

    def __init__(
        self, make: Factory, space: Source, scenes: Sequence[Scene], seed: int, budget: int | None = None
    ) -> None:
        self._left = Left(space, scenes)
        self._strategy = make(self._left, seed, budget)

    @property
    def about(self) -> str:
        """What the strategy says of itself, and how large the pool is."""
        said, size = about(self._strategy), len(self._left.genomes)
        return f"{said}, from a pool of {size}" if said else f"from a pool of {size}"

    def ask(self, n: int) -> list[Proposal]:
        """The nearest unused scenes, fewer at the end."""
        wanted = self._strategy.ask(min(n, int(self._left.unused.sum())))
        return [Proposal(each.id, np.array([self._left.take(each.genome)], dtype=float)) for each in wanted]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Hand it on, as if the strategy had proposed what was taken."""
        taken = [Proposal(each.id, self._left.genomes[int(each.genome[0])]) for each in proposals]
        self._strategy.tell(taken, scores)


class Left:
    """What is left of a pool, as a ``Source``: other scenes do not come out of it.

    Attributes:
        genomes: by index, the genome nearest to each scene.
        unused: ``(n,)`` which scenes are left.
    """

    def __init__(self, space: Source, scenes: Sequence[Scene]) -> None:
        self._space = space
        self.genomes = [space.nearest(scene) for scene in scenes]
        self._scenes = [space.decode(genome) for genome in self.genomes]
        self._points = np.array([space.embed(scene) for scene in self._scenes])
        self.unused = np.ones(len(scenes), dtype=bool)

    def take(self, genome: Genome) -> int:
        """Use up the nearest scene; its index."""
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
        """Any that is left; at the end, any."""
        left = np.flatnonzero(self.unused)
        return self._scenes[int(rng.choice(left)) if len(left) else int(rng.integers(len(self._scenes)))]

    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        """The nearest that is left."""
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
        """The scene itself: in a pool, each counts."""
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
