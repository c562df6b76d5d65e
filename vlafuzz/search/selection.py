"""Selection: any strategy, made to choose from a fixed pool of scenes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vlafuzz.errors import SceneError
from vlafuzz.scene import Scene
from vlafuzz.scoring import Score
from vlafuzz.search.base import Genome, Proposal, Source, Strategy, about


class Selection:
    """Proposes the pool's scene that is nearest to what a strategy proposes; each once. Ends with the pool.

    Near is what is alike in meaning. The strategy is told of the scene that was taken; where no genome has
    that scene, as of one from elsewhere, of its own proposal. A genome is a scene's index, as in ``Pool``.
    """

    def __init__(self, strategy: Strategy, space: Source, scenes: Sequence[Scene]) -> None:
        self._strategy, self._space, self._scenes = strategy, space, scenes
        self._points = np.array([space.meaningful(scene) for scene in scenes])
        self._unused = np.ones(len(scenes), dtype=bool)
        self._wanted: dict[int, Proposal] = {}

    @property
    def about(self) -> str:
        """What the strategy says of itself, and how large the pool is."""
        said = about(self._strategy)
        return (
            f"{said}, from a pool of {len(self._scenes)}" if said else f"from a pool of {len(self._scenes)}"
        )

    def ask(self, n: int) -> list[Proposal]:
        """The nearest unused scenes, fewer at the end."""
        wanted = self._strategy.ask(min(n, int(self._unused.sum())))
        self._wanted |= {proposal.id: proposal for proposal in wanted}
        return [Proposal(proposal.id, np.array([self._take(proposal)], dtype=float)) for proposal in wanted]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Hand it on, as if the strategy had proposed what was taken."""
        taken = [Proposal(each.id, self._genome(each)) for each in proposals]
        self._strategy.tell(taken, scores)

    def _take(self, proposal: Proposal) -> int:
        here = self._space.meaningful(self._space.decode(proposal.genome))
        distances = np.linalg.norm(self._points - here, axis=1)
        nearest = int(np.argmin(np.where(self._unused, distances, np.inf)))
        self._unused[nearest] = False
        return nearest

    def _genome(self, proposal: Proposal) -> Genome:
        wanted = self._wanted.pop(proposal.id)
        try:
            return self._space.encode(self._scenes[int(proposal.genome[0])])
        except SceneError:
            return wanted.genome
