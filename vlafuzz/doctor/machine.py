"""Checks of this machine: what is installed, and what follows from it."""

import platform
from collections.abc import Iterator

from vlafuzz import __version__
from vlafuzz.common.check import Check
from vlafuzz.common.text import plural
from vlafuzz.rollouts.capacity import most_workers, usable_cores
from vlafuzz.worlds import known_worlds


def machine() -> Iterator[Check]:
    """All checks, those that the worlds have among them; they take some seconds."""
    yield Check("python", platform.python_version())
    yield Check("vlafuzz", __version__)
    workers = plural(most_workers(), "worker")
    yield Check("cores", str(usable_cores()), "ok", f"{workers} by default, if memory stays as free as now")
    try:
        worlds = known_worlds().values()
    except ImportError as error:  # of what the package itself needs
        yield Check("packages", f"ImportError: {error}", "refuse", "nothing runs; hint: run scripts/setup")
        return
    for world in worlds:
        yield from world.machine()
