"""Strategy: what proposes scenes. It sees numbers only: genomes out, scores in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vlafuzz.scene import Scene
from vlafuzz.scoring import Measure, Score
from vlafuzz.space.params import Gene

Genome = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Proposal:
    """A genome to try. ``id`` counts a run's proposals from 0; ``genome`` is ``(dim,)``, in [0, 1]."""

    id: int
    genome: Genome


class Source(Measure, Protocol):
    """What a strategy may know of the space that it searches."""

    @property
    def genes(self) -> Sequence[Gene]:
        """What each coordinate of a genome stands for."""

    @property
    def dim(self) -> int:
        """Length of a genome."""

    def sample(self, rng: np.random.Generator) -> Scene:
        """A random scene that keeps the preconditions."""

    def encode(self, scene: Scene) -> Genome:
        """The scene's coordinates, ``(dim,)``."""

    def decode(self, genome: Genome) -> Scene:
        """The scene at these coordinates."""

    def nearest(self, scene: Scene) -> Genome:
        """The coordinates of the nearest scene that has any: for scenes from elsewhere."""

    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        """One near it that keeps the preconditions; None when there is no room for it."""

    def site(self, scene: Scene, severities: Mapping[str, float]) -> str:
        """Where in the space it lies: what fails at one site may well be one bug."""

    def embed(self, scene: Scene) -> NDArray[np.float64]:
        """``(k,)`` numbers whose Euclidean distance says how different two scenes are."""


class Strategy(Protocol):
    """Proposes genomes and is told what became of them.

    One that chose something by itself, such as a size by the budget, may say so in an attribute ``about``.
    """

    def ask(self, n: int) -> list[Proposal]:
        """Up to ``n`` new proposals, with consecutive ids; fewer, or none, when there are no more."""

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Every proposal exactly once, in the order asked; a known scene with its known score."""


def about(strategy: Strategy) -> str:
    """What it says of itself, in a few words; nothing when it has no ``about``."""
    return str(getattr(strategy, "about", ""))
