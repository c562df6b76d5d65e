"""Suites of other worlds, named ``WORLD:SUITE``: where their own initial states are audited."""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module

from vlafuzz.sim.audit import AuditedSuite, Scope

# World → module with ``audit(suite, scope)``; imported only when it is asked for.
AUDITS = {"libero": "vlafuzz.sim.libero.audit"}


def is_suite(name: str) -> bool:
    """Whether a name is ``WORLD:SUITE`` and no file."""
    return name.partition(":")[0] in AUDITS and ":" in name and not os.path.exists(name)


def audit_suite(name: str, scope: Scope) -> AuditedSuite:
    """Audit the suite ``WORLD:SUITE``.

    Raises:
        UsageError: there is no such suite.
        PrerequisiteError: the world's packages are not installed.
    """
    world, _, suite = name.partition(":")
    audit: Callable[[str, Scope], AuditedSuite] = import_module(AUDITS[world]).audit
    return audit(suite, scope)
