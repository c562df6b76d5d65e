"""Strategy: proposes scenes. It sees numbers only: genomes out, scores in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from vlafuzz.model import Space
from vlafuzz.model.genes import Genome as Genome
from vlafuzz.search.probability import Probability
from vlafuzz.search.scoring import Score

Source = Space  # of scenes, as strategies call it: they sample, encode, decode and repair there
BATCH = 16  # proposals
RANDOM = "random"  # the strategy whose share of failures is the policy's failure rate
POOL = "pool"  # all scenes of a file, which may be picked because they failed


@dataclass(frozen=True, eq=False)
class Proposal:
    """A genome to try. ``id`` counts a run's proposals from 0; ``genome`` is ``(dim,)``, in [0, 1]."""

    id: int
    genome: Genome


@dataclass(frozen=True, eq=False)
class Cause:
    """Why the policy fails, as far as a strategy has found out.

    Attributes:
        genome: of the smallest scene known to fail for this reason.
        operators: that it takes, the confounders' as one: see ``triage.path.GROUPS``.
        failures: of the run that it explains, this scene's included.
        share: of random scenes that fail for this reason; None if it is not estimated.
        tests: rollouts close to its scene since it was suspected, whether each failed: with its operators alone under
            an empty name, and without one of them under the name of that.
    """

    genome: Genome
    operators: tuple[str, ...]
    failures: int
    share: Probability | None = None
    tests: Mapping[str, tuple[bool, ...]] = field(default_factory=dict)


class Strategy(Protocol):
    """Proposes genomes and learns from their scores.

    A strategy may also have any of these:
        about: what it chose by itself, such as a population size, in a few words.
        outstanding: it is asked for one proposal at a time, while up to so many outcomes, or another number that the
            user gives, are outstanding. Without it, it is told of a whole batch before the next.
        ahead(n): genomes among the next ``n`` proposals that it expects whatever the outcomes: an executor that would
            wait rolls them out early. It changes nothing that is proposed later.
        causes(): the causes that it has found so far; if that takes long, ``found`` is their number. Then
            ``unexplained`` holds the failures for which it found none, ``probability()`` estimates the probability that
            the policy fails in a random scene, and ``at_random`` holds the ids of the proposals that are random scenes,
            whether they passed or failed.
        conclude(): to propose from now on only what finds causes of the failures so far, once the budget is spent.
    """

    def ask(self, n: int) -> list[Proposal]:
        """Up to ``n`` new proposals with consecutive ids; fewer, or none, when the space is exhausted."""

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Receive the score of every proposal exactly once, in the order of ``ask``, stored ones included."""


def said_by(strategy: Strategy, name: str, default: Any) -> Any:
    """What a strategy says beside ``ask`` and ``tell``, see ``Strategy``; a method is called."""
    said = getattr(strategy, name, default)
    return said() if callable(said) else said


def overlaps(strategy: Strategy) -> bool:
    """Whether a strategy may be asked while outcomes of earlier proposals are outstanding."""
    return hasattr(strategy, "outstanding")


def batch_of(strategy: Strategy) -> int:
    """How many proposals of a strategy are evaluated at a time by default."""
    return int(getattr(strategy, "outstanding", BATCH))


def looks_for_causes(strategy: Strategy) -> bool:
    return hasattr(strategy, "causes")
