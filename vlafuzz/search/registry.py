"""Strategies by name, the user's own included."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, cast

import numpy as np

from vlafuzz.common.plugins import is_reference, load_factory, users_code
from vlafuzz.errors import UsageError
from vlafuzz.model.conditions import check_choice
from vlafuzz.search.base import POOL, Proposal, Source, Strategy
from vlafuzz.search.causes.strategy import Causes
from vlafuzz.search.feedback import Feedback
from vlafuzz.search.nsga2 import Nsga2
from vlafuzz.search.proposals import Random
from vlafuzz.search.scoring import Score
from vlafuzz.search.severity import Severity
from vlafuzz.search.surrogate import Surrogate

Factory = Callable[[Source, int, int | None], Strategy]
"""``(space, seed, budget)`` to a strategy: what ``python:pkg.mod:factory`` has to name.

``budget`` is the number of scenes to be rolled out; None if it is unknown.
"""


STRATEGIES: dict[str, Factory] = {
    "random": Random,
    "nsga2": Nsga2,
    "feedback": Feedback,
    "surrogate": Surrogate,
    "severity": Severity,
    "causes": Causes,
}
_HINT = "see vlafuzz.search.base.Strategy"


def _own(name: str, make: Factory, space: Source, seed: int, budget: int | None) -> Strategy:
    with users_code(name):
        return Own(name, make(space, seed, budget), space.dim)


def strategy_factory(name: str) -> Factory:
    """The factory of the strategy of that name; a UsageError if there is none."""
    if is_reference(name):
        return partial(_own, name, cast(Factory, load_factory(name)))
    if name == POOL:
        raise UsageError(f"strategy {POOL!r} needs a file of scenes", hint="give it with --scenes")
    return STRATEGIES[check_choice("strategy", name, STRATEGIES)]


class Own:
    """Delegates to the user's strategy; a wrong proposal is an error in one sentence."""

    def __init__(self, name: str, strategy: Strategy, dim: int) -> None:
        for method in ("ask", "tell"):
            if not callable(getattr(strategy, method, None)):
                kind = type(strategy).__name__
                raise UsageError(f"{name!r} returned a {kind}, which has no {method}", hint=_HINT)
        self._name, self._strategy, self._dim, self._asked = name, strategy, dim, 0

    def __getattr__(self, name: str) -> Any:
        """What a strategy may have beside ``ask`` and ``tell``."""
        return getattr(self._strategy, name)

    def ask(self, n: int) -> list[Proposal]:
        """Its proposals; a UsageError if an id or a genome is wrong, a PrerequisiteError if the user's code raises."""
        with users_code(self._name):
            proposals = list(self._strategy.ask(n))
        for number, proposal in enumerate(proposals, self._asked):
            if proposal.id != number:
                raise self._wrong(f"proposal {number} has the id {proposal.id}")
            genome, shape = f"the genome of proposal {number}", np.shape(proposal.genome)
            if shape != (self._dim,):
                raise self._wrong(f"{genome} has the shape {shape}, not {(self._dim,)}")
            if outside := [float(gene) for gene in proposal.genome if not 0 <= gene <= 1]:
                raise self._wrong(f"{genome} has {outside[0]:g}, which is not in [0, 1]")
        self._asked += len(proposals)
        return proposals

    def tell(self, proposals: Sequence[Proposal], scores: Sequence[Score]) -> None:
        """Pass the scores on; PrerequisiteError if the user's code raises."""
        with users_code(self._name):
            self._strategy.tell(proposals, scores)

    def _wrong(self, what: str) -> UsageError:
        return UsageError(f"strategy {self._name!r}: {what}", hint=_HINT)
