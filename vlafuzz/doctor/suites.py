"""Suites of worlds, named ``WORLD:SUITE``: their own initial states are audited."""

from __future__ import annotations

import os

from vlafuzz.worlds import known_worlds
from vlafuzz.worlds.audit import AuditedSuite, Scope
from vlafuzz.worlds.capabilities import Audited


def is_suite(name: str) -> bool:
    """Whether a name is ``WORLD:SUITE`` and no file."""
    return _audited(name) is not None and ":" in name and not os.path.exists(name)


def audit_suite(name: str, scope: Scope) -> AuditedSuite:
    """Audit the suite ``WORLD:SUITE``.

    Raises:
        UsageError: there is no such suite.
        PrerequisiteError: the world's packages are not installed.
    """
    world = _audited(name)
    assert world is not None, "see is_suite"
    return world.audit(name.partition(":")[2], scope)


def _audited(name: str) -> Audited | None:
    world = known_worlds().get(name.partition(":")[0])
    return world if isinstance(world, Audited) else None
