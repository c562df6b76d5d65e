"""Nursery: where genomes become proposals: fair scenes, as far as bounded repair goes, and new ones.

It makes genomes as the space encodes scenes: of one scene there is one only.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vlafuzz.search.base import Genome, Source

REDRAWS = 20  # fresh scenes that turn out to be known before one is proposed again: tiny spaces run out


class ProposalFactory:
    """Knows every scene that was proposed."""

    def __init__(self, space: Source) -> None:
        self._space = space
        self._seen: set[int] = set()

    def fresh(self, rng: np.random.Generator) -> Genome:
        """A random scene, a new one if there still are any; from now on it is known."""
        return self.registered(self.drawn(rng))

    def drawn(self, rng: np.random.Generator) -> Genome:
        """The same, but it stays unknown."""
        for _ in range(REDRAWS):
            genome = self._space.nearest(self._space.sample(rng))
            if self._mark(genome) not in self._seen:
                break
        return genome

    def fair(self, genome: Genome, rng: np.random.Generator) -> Genome:
        """The genome of the fair scene nearest to this one's; a random one where there is no room for it."""
        scene = self._space.repaired(self._space.decode(genome), rng)
        return self._space.nearest(self._space.sample(rng) if scene is None else scene)

    def new(self, genomes: Sequence[Genome], earlier: Sequence[Genome] = ()) -> NDArray[np.bool_]:
        """``(n,)`` whether a genome's scene is new: not proposed, not ``earlier``, not here twice."""
        known, found = set(map(self._mark, earlier)), []
        for mark in map(self._mark, genomes):
            found.append(mark not in self._seen and mark not in known)
            known.add(mark)
        return np.array(found, dtype=bool)

    def registered(self, genome: Genome) -> Genome:
        """The same genome, from now on known."""
        self._seen.add(self._mark(genome))
        return genome

    def _mark(self, genome: Genome) -> int:
        """64 bits of it: millions take little room, and two hardly ever have the same."""
        return hash(genome.tobytes())
