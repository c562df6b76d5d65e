"""Strategy: proposes scenes. It sees numbers only: genomes out, scores in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vlafuzz.model.genes import Gene
from vlafuzz.model.scene import Scene
from vlafuzz.search.probability import Probability
from vlafuzz.search.scoring import Measure, Score

Genome = NDArray[np.float64]
BATCH = 16  # proposals
RANDOM = "random"  # the strategy whose share of failures is the policy's failure rate
POOL = "pool"  # all scenes of a file, which may be picked because they failed


@dataclass(frozen=True, eq=False)
class Proposal:
    """A genome to try. ``id`` counts a run's proposals from 0; ``genome`` is ``(dim,)``, in [0, 1]."""

    id: int
    genome: Genome


class Source(Measure, Protocol):
    """What a strategy may know of the search space."""

    @property
    def genes(self) -> Sequence[Gene]:
        """The coordinates of a genome, in order."""

    @property
    def dim(self) -> int:
        """The length of a genome."""

    def sample(self, rng: np.random.Generator) -> Scene:
        """A random scene that keeps the preconditions."""

    def encode(self, scene: Scene) -> Genome:
        """The scene's coordinates, ``(dim,)``."""

    def decode(self, genome: Genome) -> Scene:
        """The scene at these coordinates."""

    def nearest(self, scene: Scene) -> Genome:
        """The genome of the nearest scene on the grid: for scenes from elsewhere."""

    def repaired(self, scene: Scene, rng: np.random.Generator) -> Scene | None:
        """A scene near this one that keeps the preconditions; None when there is no room for it."""

    def site(self, scene: Scene, severities: Mapping[str, float]) -> str:
        """Where in the space a scene lies: failures at one site may well have one cause."""

    def embed(self, scene: Scene) -> NDArray[np.float64]:
        """A ``(k,)`` embedding: its Euclidean distance says how different two scenes are."""


@dataclass(frozen=True, eq=False)
class Cause:
    """Why the policy fails, as far as a strategy has found out.

    Attributes:
        genome: of the smallest scene known to fail for this reason.
        operators: that it takes, the confounders' as one: see ``triage.path.GROUPS``.
        failures: of the run that it explains, this scene's included.
        share: of random scenes that fail for this reason; None if it is not estimated.
    """

    genome: Genome
    operators: tuple[str, ...]
    failures: int
    share: Probability | None = None


class Strategy(Protocol):
    """Proposes genomes and learns from their scores.

    An optional attribute ``about`` describes what the strategy chose by itself, such as a population size. A
    strategy with the optional attribute ``outstanding`` is asked for one proposal at a time, while up to so
    many outcomes, or another number that the user gives, are outstanding; one without it is told of a whole
    batch before it is asked for the next. An optional method ``causes`` returns the causes that it has found
    so far; of such a strategy an optional attribute ``unexplained`` holds the failures for which it found
    none, an optional method ``probability`` estimates the probability that the policy fails in a random
    scene, and an optional attribute ``at_random`` holds the ids of the proposals that are random scenes.
    """

    def ask(self, n: int) -> list[Proposal]:
        """Up to ``n`` new proposals with consecutive ids; fewer, or none, when the space is exhausted."""

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Receive the score of every proposal exactly once, in the order of ``ask``, stored ones included."""


def about(strategy: Strategy) -> str:
    """The strategy's description of itself in a few words; empty if it has no ``about``."""
    return str(getattr(strategy, "about", ""))


def overlaps(strategy: Strategy) -> bool:
    """Whether a strategy may be asked while outcomes of earlier proposals are outstanding."""
    return hasattr(strategy, "outstanding")


def batch_of(strategy: Strategy) -> int:
    """How many proposals of a strategy are evaluated at a time by default."""
    return int(getattr(strategy, "outstanding", BATCH))


def causes(strategy: Strategy) -> Sequence[Cause]:
    """The causes that a strategy has found so far; none if it does not look for them."""
    find = getattr(strategy, "causes", None)
    return find() if find else ()


def causes_found(strategy: Strategy) -> int:
    """How many there are; a strategy whose ``causes`` take long says so in ``found``."""
    found = getattr(strategy, "found", None)
    return len(causes(strategy)) if found is None else int(found)


def looks_for_causes(strategy: Strategy) -> bool:
    return hasattr(strategy, "causes")


def unexplained(strategy: Strategy) -> int:
    """The number of failures for which a strategy that looks for causes has found none."""
    return len(getattr(strategy, "unexplained", ()))


def at_random(strategy: Strategy) -> tuple[int, ...]:
    """The ids of the proposals that a strategy says are random scenes, which passed or failed."""
    return tuple(getattr(strategy, "at_random", ()))


def probability(strategy: Strategy) -> Probability | None:
    """The probability that the policy fails in a random scene; None if the strategy does not estimate it."""
    estimate = getattr(strategy, "probability", None)
    return estimate() if estimate else None
