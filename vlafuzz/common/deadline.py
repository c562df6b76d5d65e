"""Deadline: a bound on the time that work takes, as users give it: 90s, 30m, 1h, 1h30m."""

from __future__ import annotations

import math
import re
import time

from vlafuzz.errors import UsageError


class TimeOverError(Exception):
    """A deadline has passed, and what was begun before is done."""


_FORM = re.compile(r"(?:(\d+(?:\.\d+)?)h)?(?:(\d+(?:\.\d+)?)m)?(?:(\d+(?:\.\d+)?)s)?")
_SECONDS = (3600, 60, 1)


class Deadline:
    """The end of a period in seconds that begins now; without an end by default."""

    def __init__(self, seconds: float = math.inf) -> None:
        self._end = time.monotonic() + seconds

    @property
    def left(self) -> float:
        """Seconds that are left; negative when it has passed, infinite without an end."""
        return self._end - time.monotonic()

    @property
    def passed(self) -> bool:
        return self.left <= 0

    def after(self, share: float) -> Deadline:
        """The deadline after a share of the time that is left."""
        return Deadline(max(self.left, 0.0) * share)


def deadline(flag: str, text: str | None) -> Deadline:
    """The deadline that a flag names, counted from now; UsageError if the text is no period."""
    if text is None:
        return Deadline()
    parts = _FORM.fullmatch(text.replace(" ", "").lower())
    numbers = parts.groups(default="0") if parts else ()
    seconds = sum(float(number) * unit for number, unit in zip(numbers, _SECONDS, strict=False))
    if not seconds:
        raise UsageError(f"{flag}: expected a time, got {text!r}", hint="such as 1h, 30m, 90s or 1h30m")
    return Deadline(seconds)
