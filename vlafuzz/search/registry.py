"""Strategies by name, the user's own included."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, cast

import numpy as np

from vlafuzz.common.plugins import is_reference, load_factory, users_code
from vlafuzz.errors import UsageError, suggestion
from vlafuzz.search.base import POOL, Genome, Proposal, Source, Strategy
from vlafuzz.search.baselines.mcts import Mcts
from vlafuzz.search.feedback import Feedback
from vlafuzz.search.proposals import Random
from vlafuzz.search.scoring import Score

Factory = Callable[[Source, int, int | None], Strategy]
"""``(space, seed, budget)`` to a strategy: what ``python:pkg.mod:factory`` has to name.

``budget`` is the number of scenes to be rolled out; None if it is unknown.
"""


def _nsga2(space: Source, seed: int, budget: int | None) -> Strategy:
    """Evolves scenes toward early failures, near nominal and unlike known ones: Deb et al. 2002."""
    from vlafuzz.search.nsga2 import Nsga2  # pymoo takes half a second to import

    return Nsga2(space, seed, budget)


def _nsga2d(space: Source, seed: int, budget: int | None) -> Strategy:
    """NSGA-II that keeps away from known failures and draws fresh scenes when it stalls. A baseline."""
    from vlafuzz.search.baselines.nsga2d import Nsga2D

    return Nsga2D(space, seed, budget)


def _map_elites(space: Source, seed: int, budget: int | None) -> Strategy:
    """Varies the best scene of every niche: lost stage, farthest operator, target's place. A baseline."""
    from vlafuzz.search.baselines.map_elites import MapElites  # pyribs takes a second to import

    return MapElites(space, seed, budget)


def _art_rf(space: Source, seed: int, budget: int | None) -> Strategy:
    """Fresh scenes far from all before that a random forest predicts to fail: FATE-VLA's. A baseline."""
    from vlafuzz.search.baselines.art_rf import ArtRf

    return ArtRf(space, seed, budget)


def _surrogate(space: Source, seed: int, budget: int | None, **switches: bool) -> Strategy:
    """Rolls out what a forest predicts to fail in cells that have no failure yet; else random."""
    from vlafuzz.search.surrogate import Surrogate  # scikit-learn takes a second to import

    return Surrogate(space, seed, budget, **switches)


def _causes(space: Source, seed: int, budget: int | None, **switches: Any) -> Strategy:
    """Attributes failures to operators as they come, and looks where no known cause explains a failure."""
    from vlafuzz.search.causes.strategy import Causes

    return Causes(space, seed, budget, **switches)


STRATEGIES: dict[str, Factory] = {
    "random": Random,
    "nsga2": _nsga2,
    "nsga2d": _nsga2d,
    "feedback": Feedback,
    "map-elites": _map_elites,
    "art-rf": _art_rf,
    "mcts": Mcts,
    "surrogate": _surrogate,
    "causes": _causes,
}
# Reachable by name, for scripts/bench_strategies.py; not listed.
ABLATIONS: dict[str, Factory] = {
    "surrogate-without-forest": partial(_surrogate, forest=False),
    "surrogate-without-novelty": partial(_surrogate, novelty=False),
    "surrogate-without-fallback": partial(_surrogate, fallback=False),
    "causes-without-avoiding": partial(_causes, avoid=False),
    "causes-without-suspects": partial(_causes, guided=False),
}
_HINT = "see vlafuzz.search.base.Strategy"


def _own(name: str, make: Factory, space: Source, seed: int, budget: int | None) -> Strategy:
    with users_code(name):
        return Own(name, make(space, seed, budget), space.dim)


def strategy_factory(name: str) -> Factory:
    """The factory of the strategy of that name, ablations included.

    Raises:
        UsageError: no such strategy.
    """
    if is_reference(name):
        return partial(_own, name, cast(Factory, load_factory(name)))
    if name == POOL:
        raise UsageError(f"strategy {POOL!r} needs a file of scenes", hint="give it with --scenes")
    if name not in STRATEGIES | ABLATIONS:
        raise UsageError(f"unknown strategy {name!r}", hint=suggestion(name, STRATEGIES))
    return (STRATEGIES | ABLATIONS)[name]


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
        """Pass the scores on; PrerequisiteError if the user's code raises."""
        with users_code(self._name):
            self._strategy.tell(proposals, scores)

    def _wrong(self, what: str) -> UsageError:
        return UsageError(f"strategy {self._name!r}: {what}", hint=_HINT)


def _flaw(genome: Genome, dim: int) -> str | None:
    if np.shape(genome) != (dim,):
        return f"has the shape {np.shape(genome)}, not {(dim,)}"
    outside = [float(gene) for gene in genome if not 0 <= gene <= 1]
    return f"has {outside[0]:g}, which is not in [0, 1]" if outside else None
