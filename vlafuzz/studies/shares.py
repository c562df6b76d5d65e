"""Share: how many of how many, with its interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from vlafuzz.statistics import Interval, share_interval, wilson


@dataclass(frozen=True)
class Share:
    """``count`` of ``of``, with a 95 % interval from ``low`` to ``high``; of none, the share is 0."""

    count: int
    of: int
    share: float
    low: float
    high: float

    @classmethod
    def counted(cls, so: Sequence[bool]) -> Self:
        """Of independent cases, with Wilson's interval."""
        return cls._of(sum(so), len(so), wilson(sum(so), len(so)))

    @classmethod
    def grouped(cls, cases: Sequence[tuple[int, bool]]) -> Self:
        """Of cases with what group each belongs to: those of a group may well resemble each other."""
        count = sum(so for _, so in cases)
        return cls._of(count, len(cases), share_interval(cases) if cases else Interval(0.0, 1.0))

    @classmethod
    def _of(cls, count: int, of: int, interval: Interval) -> Self:
        return cls(count, of, count / of if of else 0.0, *interval)

    def __str__(self) -> str:
        return f"{self.share:.1%} ({self.low:.1%}–{self.high:.1%})" if self.of else "–"
