"""Own: a user's own strategy, of which nobody knows whether it keeps to what a strategy promises."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vlafuzz.errors import UsageError
from vlafuzz.plugins import users_code
from vlafuzz.scoring import Score
from vlafuzz.search.base import Genome, Proposal, Strategy, about

_HINT = "see vlafuzz.search.base.Strategy"


class Own:
    """Hands on what it is asked and told, and says in a sentence what is wrong with the proposals."""

    def __init__(self, name: str, strategy: Strategy, dim: int) -> None:
        for method in ("ask", "tell"):
            if not callable(getattr(strategy, method, None)):
                made = type(strategy).__name__
                raise UsageError(f"{name!r} made a {made}, which has no {method}", hint=_HINT)
        self._name, self._strategy, self._dim, self._asked = name, strategy, dim, 0

    @property
    def about(self) -> str:
        """What it says of itself."""
        return about(self._strategy)

    def ask(self, n: int) -> list[Proposal]:
        """Its proposals.

        Raises:
            UsageError: an id is not the next one, or a genome not one of the space.
            PrerequisiteError: it raises.
        """
        with users_code(self._name):
            proposals = list(self._strategy.ask(n))
        for number, proposal in enumerate(proposals, self._asked):
            if proposal.id != number:
                raise self._wrong(f"proposal {number} has the id {proposal.id}")
            flaw = _flaw(proposal.genome, self._dim)
            if flaw:
                raise self._wrong(f"the genome of proposal {number} {flaw}")
        self._asked += len(proposals)
        return proposals

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """As it is.

        Raises:
            PrerequisiteError: it raises.
        """
        with users_code(self._name):
            self._strategy.tell(proposals, scores)

    def _wrong(self, what: str) -> UsageError:
        return UsageError(f"strategy {self._name!r}: {what}", hint=_HINT)


def _flaw(genome: Genome, dim: int) -> str | None:
    if np.shape(genome) != (dim,):
        return f"has the shape {np.shape(genome)}, not {(dim,)}"
    outside = [float(gene) for gene in genome if not 0 <= gene <= 1]
    return f"has {outside[0]:g}, which is not in [0, 1]" if outside else None
