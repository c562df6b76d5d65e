"""Check: one row of what the doctor says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal, NamedTuple

Rating = Literal["ok", "warn", "refuse"]


class Check(NamedTuple):
    """One row: ``refuse`` means that nothing is to be run before this is put right.

    Attributes:
        check: what was looked at.
        found: what there is, with figures.
        follows: from it, and what to do; empty where all is well.
    """

    check: str
    found: str
    verdict: Rating
    follows: str = ""


def until_refused(checks: Iterable[Check]) -> Iterator[Check]:
    """Up to the first that is refused: what comes after it would only show the same fault again."""
    for check in checks:
        yield check
        if check.verdict == "refuse":
            return
