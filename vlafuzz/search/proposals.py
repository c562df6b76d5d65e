"""What strategies share: fair and new genomes, numbered proposals; strategies that learn nothing."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from vlafuzz.search.base import Genome, Proposal, Source
from vlafuzz.search.scoring import Score

REDRAWS = 20  # draws of known scenes before one is proposed again: tiny spaces run out
UNLIMITED = 64  # outstanding proposals of a strategy that learns nothing: it could do with any number
TRIES = 10  # known children before a random scene is proposed instead

Rng = np.random.Generator
Points = NDArray[np.float64]  # (n, k)


class ProposalFactory:
    """Turns genomes into proposals that are fair, as far as bounded repair goes, and new.

    Remembers every scene that was proposed. Genomes are canonical, as the space encodes scenes: one scene has one
    genome.
    """

    def __init__(self, space: Source) -> None:
        self._space = space
        self._seen: set[int] = set()

    def fresh(self, rng: Rng) -> Genome:
        """A random scene, new if possible, and registered."""
        return self.registered(self.drawn(rng))

    def drawn(self, rng: Rng) -> Genome:
        """The same, not registered."""
        for _ in range(REDRAWS):
            genome = self.sampled(rng)
            if self._mark(genome) not in self._seen:
                break
        return genome

    def sampled(self, rng: Rng) -> Genome:
        """A random scene, whether new or known; not registered."""
        return self._space.nearest(self._space.sample(rng))

    def first_new(self, child: Callable[[], Genome], rng: Rng) -> Genome:
        """The first of a few children that is new once it is fair, else a random scene; registered."""
        for _ in range(TRIES):
            genome = self.fair(child(), rng)
            if self.new([genome])[0]:
                return self.registered(genome)
        return self.fresh(rng)

    def fair(self, genome: Genome, rng: Rng) -> Genome:
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


class OneByOne(ABC):
    """A strategy that makes one proposal at a time.

    Each proposal has its own random generator: batch size and workers do not change random scenes.
    """

    def __init__(self, space: Source, seed: int, budget: int | None = None) -> None:
        self._space, self._seed, self._asked = space, seed, 0
        self._proposals = ProposalFactory(space)

    def ask(self, n: int) -> list[Proposal]:
        """``n`` proposals."""
        first, self._asked = self._asked, self._asked + n
        return [
            Proposal(number, self._genome(number, np.random.default_rng([self._seed, number])))
            for number in range(first, self._asked)
        ]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:  # noqa: B027
        """Learn from the scores; by default nothing."""

    @abstractmethod
    def _genome(self, number: int, rng: Rng) -> Genome:
        """The genome of the proposal with this id."""


class Random(OneByOne):
    """Draws scenes independently of earlier outcomes: VLATest's strategy."""

    outstanding = UNLIMITED

    def _genome(self, number: int, rng: Rng) -> Genome:
        return self._space.encode(self._space.sample(rng))


class InOrder:
    """Proposes so many scenes of a file in order, each once: a genome is a scene's index, not in [0, 1]."""

    outstanding = UNLIMITED

    def __init__(self, size: int) -> None:
        self._size, self._asked = size, 0

    def ask(self, n: int) -> list[Proposal]:
        """The next ``n`` scenes, fewer at the end."""
        first, self._asked = self._asked, min(self._asked + n, self._size)
        return [Proposal(index, np.array([index], dtype=np.float64)) for index in range(first, self._asked)]

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Scores change nothing."""


class Archive:
    """The last ``capacity`` points: bounded, so that the cost of a query does not grow with the run."""

    def __init__(self, capacity: int = 500) -> None:
        self._points: Points | None = None
        self._capacity, self._added = capacity, 0

    def __len__(self) -> int:
        return min(self._added, self._capacity)

    def add(self, point: NDArray[np.float64]) -> None:
        """Keep a ``(k,)`` point; when the archive is full it replaces the oldest."""
        if self._points is None:
            self._points = np.empty((self._capacity, len(point)))
        self._points[self._added % self._capacity] = point
        self._added += 1

    def novelty(self, points: Points, neighbours: int = 5) -> NDArray[np.float64]:
        """``(n,)`` mean distance to the nearest points in the archive; 0 for an empty archive.

        A point that is in the archive is not its own neighbour.
        """
        if self._points is None:
            return np.zeros(len(points))
        known = self._points[: len(self)]
        squares = (points**2).sum(axis=1)[:, None] + (known**2).sum(axis=1) - 2 * points @ known.T
        distances = np.sort(np.sqrt(np.maximum(squares, 0.0)), axis=1)
        own = distances[:, 0] < 1e-6
        nearest = np.where(own[:, None], np.roll(distances, -1, axis=1), distances)[:, :neighbours]
        counted = np.minimum(len(known) - own, neighbours)
        kept = np.where(np.arange(nearest.shape[1]) < counted[:, None], nearest, 0.0)
        return np.asarray(kept.sum(axis=1) / np.maximum(counted, 1))
