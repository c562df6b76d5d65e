"""Strategies by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from vlafuzz.errors import UsageError, suggestion
from vlafuzz.plugins import is_reference, load_factory
from vlafuzz.search.base import Source, Strategy
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


STRATEGIES: dict[str, Factory] = {"random": Random, "nsga2": _nsga2, "feedback": Feedback}
POOL = "pool"


def strategy_factory(name: str) -> Factory:
    """What makes the strategy of that name.

    Raises:
        UsageError: no such strategy.
    """
    if is_reference(name):
        make = cast(Factory, load_factory(name))
        return lambda space, seed, budget: Own(name, make(space, seed, budget), space.dim)
    if name == POOL:
        raise UsageError(f"strategy {POOL!r} needs a file of scenes", hint="give it with --scenes")
    if name not in STRATEGIES:
        raise UsageError(f"unknown strategy {name!r}", hint=suggestion(name, STRATEGIES))
    return STRATEGIES[name]
