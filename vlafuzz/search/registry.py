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

``budget`` is how many scenes will be rolled out; None when nobody knows.
"""


def _nsga2(space: Source, seed: int, budget: int | None) -> Strategy:
    """Evolves scenes toward failures that come early, near to nominal and unlike others: Deb et al. 2002."""
    from vlafuzz.search.nsga2 import Nsga2  # pymoo takes half a second to import

    return Nsga2(space, seed, budget)


def _nsga2d(space: Source, seed: int, budget: int | None) -> Strategy:
    """NSGA-II that keeps away from the failures it has, and makes room for fresh scenes when it stalls."""
    from vlafuzz.search.baselines.nsga2d import Nsga2D

    return Nsga2D(space, seed, budget)


def _map_elites(space: Source, seed: int, budget: int | None) -> Strategy:
    """Keeps the best scene of every niche (lost stage, farthest operator, target's place) and varies them."""
    from vlafuzz.search.baselines.map_elites import MapElites  # pyribs takes a second to import

    return MapElites(space, seed, budget)


def _art_rf(space: Source, seed: int, budget: int | None) -> Strategy:
    """Of fresh scenes, those far from all before that a random forest predicts to fail: after FATE-VLA."""
    from vlafuzz.search.baselines.art_rf import ArtRf

    return ArtRf(space, seed, budget)


def _surrogate(space: Source, seed: int, budget: int | None) -> Strategy:
    """Tries what a forest predicts to fail in cells that have no failure yet; else random."""
    from vlafuzz.search.surrogate import Surrogate  # scikit-learn takes a second to import

    return Surrogate(space, seed, budget)


def _without_forest(space: Source, seed: int, budget: int | None) -> Strategy:
    """``surrogate`` without its forest: children of failures in cells that have none yet. An ablation."""
    from vlafuzz.search.surrogate import Surrogate

    return Surrogate(space, seed, budget, forest=False)


def _without_novelty(space: Source, seed: int, budget: int | None) -> Strategy:
    """``surrogate`` without regard to cells: whatever is most likely to fail. An ablation."""
    from vlafuzz.search.surrogate import Surrogate

    return Surrogate(space, seed, budget, novelty=False)


def _without_fallback(space: Source, seed: int, budget: int | None) -> Strategy:
    """``surrogate`` that trusts its forest even where it predicts no better than chance. An ablation."""
    from vlafuzz.search.surrogate import Surrogate

    return Surrogate(space, seed, budget, fallback=False)


STRATEGIES: dict[str, Factory] = {
    "random": Random,
    "nsga2": _nsga2,
    "nsga2d": _nsga2d,
    "feedback": Feedback,
    "map-elites": _map_elites,
    "art-rf": _art_rf,
    "mcts": Mcts,
    "surrogate": _surrogate,
    "surrogate-without-forest": _without_forest,
    "surrogate-without-novelty": _without_novelty,
    "surrogate-without-fallback": _without_fallback,
}
POOL = "pool"


def _own(name: str, make: Factory, space: Source, seed: int, budget: int | None) -> Strategy:
    with users_code(name):
        return Own(name, make(space, seed, budget), space.dim)


def strategy_factory(name: str) -> Factory:
    """What makes the strategy of that name.

    Raises:
        UsageError: no such strategy.
    """
    if is_reference(name):
        return partial(_own, name, cast(Factory, load_factory(name)))
    if name == POOL:
        raise UsageError(f"strategy {POOL!r} needs a file of scenes", hint="give it with --scenes")
    if name not in STRATEGIES:
        raise UsageError(f"unknown strategy {name!r}", hint=suggestion(name, STRATEGIES))
    return STRATEGIES[name]
