"""Own: wraps a user's strategy and checks that it keeps the contract of ``Strategy``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vlafuzz.errors import UsageError
from vlafuzz.plugins import users_code
from vlafuzz.scoring import Score
from vlafuzz.search.base import Genome, Proposal, Strategy, about

_HINT = "see vlafuzz.search.base.Strategy"


class Own:
    """Delegates to the user's strategy; a wrong proposal is an error in one sentence."""

    def __init__(self, name: str, strategy: Strategy, dim: int) -> None:
        for method in ("ask", "tell"):
            if not callable(getattr(strategy, method, None)):
                kind = type(strategy).__name__
                raise UsageError(f"{name!r} returned a {kind}, which has no {method}", hint=_HINT)
        self._name, self._strategy, self._dim, self._asked = name, strategy, dim, 0

    @property
    def about(self) -> str:
        """See ``Strategy``."""
        return about(self._strategy)

    def ask(self, n: int) -> list[Proposal]:
        """The proposals of the user's strategy.

        Raises:
            UsageError: an id is not consecutive, or a genome is not one of the space.
            PrerequisiteError: the user's code raises.
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
        """Pass the scores on.

        Raises:
            PrerequisiteError: the user's code raises.
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
