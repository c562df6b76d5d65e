"""ProposalFactory: turns genomes into proposals that are fair, as far as bounded repair goes, and new.

Genomes are canonical, as the space encodes scenes: one scene has one genome.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vlafuzz.search.base import Genome, Source

REDRAWS = 20  # draws of known scenes before one is proposed again: tiny spaces run out


class ProposalFactory:
    """Remembers every scene that was proposed."""

    def __init__(self, space: Source) -> None:
        self._space = space
        self._seen: set[int] = set()

    def fresh(self, rng: np.random.Generator) -> Genome:
        """A random scene, new if possible, and registered."""
        return self.registered(self.drawn(rng))

    def drawn(self, rng: np.random.Generator) -> Genome:
        """The same, not registered."""
        for _ in range(REDRAWS):
            genome = self._space.nearest(self._space.sample(rng))
            if self._mark(genome) not in self._seen:
                break
        return genome

    def fair(self, genome: Genome, rng: np.random.Generator) -> Genome:
        """The genome of a fair scene near this one's; a random one when repair finds no room."""
        scene = self._space.repaired(self._space.decode(genome), rng)
        return self._space.nearest(self._space.sample(rng) if scene is None else scene)

    def new(self, genomes: Sequence[Genome], earlier: Sequence[Genome] = ()) -> NDArray[np.bool_]:
        """``(n,)`` whether a scene is new: not proposed before, not in ``earlier``, no duplicate in here."""
        known, new = set(map(self._mark, earlier)), []
        for mark in map(self._mark, genomes):
            new.append(mark not in self._seen and mark not in known)
            known.add(mark)
        return np.array(new, dtype=bool)

    def registered(self, genome: Genome) -> Genome:
        """The same genome, remembered as proposed."""
        self._seen.add(self._mark(genome))
        return genome

    def _mark(self, genome: Genome) -> int:
        """A 64-bit hash: millions fit into memory, and collisions are rare."""
        return hash(genome.tobytes())
