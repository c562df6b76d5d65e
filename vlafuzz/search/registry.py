"""Strategies by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from vlafuzz.errors import UsageError, suggestion
from vlafuzz.plugins import is_reference, load_factory
from vlafuzz.search.base import Source, Strategy
from vlafuzz.search.random import Random

Factory = Callable[[Source, int], Strategy]
"""``(space, seed)`` to a strategy: what ``python:pkg.mod:factory`` has to name."""

STRATEGIES: dict[str, Factory] = {"random": Random}
POOL = "pool"


def strategy_factory(name: str) -> Factory:
    """What makes the strategy of that name.

    Raises:
        UsageError: no such strategy.
    """
    if is_reference(name):
        return cast(Factory, load_factory(name))
    if name == POOL:
        raise UsageError(f"strategy {POOL!r} needs a file of scenes", hint="give it with --scenes")
    if name not in STRATEGIES:
        raise UsageError(f"unknown strategy {name!r}", hint=suggestion(name, STRATEGIES))
    return STRATEGIES[name]
