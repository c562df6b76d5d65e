"""Strategies by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import cast

from vlafuzz.errors import UsageError, suggestion
from vlafuzz.plugins import is_reference, load_factory, users_code
from vlafuzz.search.base import Source, Strategy
from vlafuzz.search.baselines.mcts import Mcts
from vlafuzz.search.feedback import Feedback
from vlafuzz.search.own import Own
from vlafuzz.search.random import Random

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


STRATEGIES: dict[str, Factory] = {
    "random": Random,
    "nsga2": _nsga2,
    "nsga2d": _nsga2d,
    "feedback": Feedback,
    "map-elites": _map_elites,
    "art-rf": _art_rf,
    "mcts": Mcts,
    "surrogate": _surrogate,
}
# Reachable by name, for scripts/bench_strategies.py; not listed.
ABLATIONS: dict[str, Factory] = {
    "surrogate-without-forest": partial(_surrogate, forest=False),
    "surrogate-without-novelty": partial(_surrogate, novelty=False),
    "surrogate-without-fallback": partial(_surrogate, fallback=False),
}
POOL = "pool"


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
