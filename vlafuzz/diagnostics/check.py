"""Check: one row of the doctor's report."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal, NamedTuple

Rating = Literal["ok", "warn", "refuse"]


class Check(NamedTuple):
    """The result of one check; ``refuse`` means that it must be corrected before anything is run.

    Attributes:
        check: name of what was checked.
        found: the observation, with figures.
        follows: the consequence, and what to do; empty when all is well.
    """

    check: str
    found: str
    verdict: Rating
    follows: str = ""


def until_refused(checks: Iterable[Check]) -> Iterator[Check]:
    """The checks up to the first refusal: later ones would only show the same fault again."""
    for check in checks:
        yield check
        if check.verdict == "refuse":
            return
