"""Numbers, names and tables as people read them."""

import math
import reprlib
from collections.abc import Iterable
from typing import Any

Row = dict[str, Any]


def named(names: Iterable[str]) -> str:
    """Names separated by commas, each once, in order."""
    return ", ".join(dict.fromkeys(names))


def plural(number: int, noun: str) -> str:
    """``1 run``, ``2 runs``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def shortened(value: object, most: int = 60) -> str:
    """What a value looks like, at most 60 characters of it; it may be as large or deep as it likes."""
    brief = reprlib.Repr()
    brief.maxlevel, brief.maxlist, brief.maxdict = 3, 20, 20
    brief.maxstring = brief.maxother = most
    try:
        shown = brief.repr(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits
        shown = f"a {type(value).__name__}"
    return shown if len(shown) <= most else shown[: most - 3] + "..."


def percent(share: float | None) -> str:
    """``58.3%``; whole numbers without a point."""
    return "–" if share is None else f"{100 * share:.1f}".removesuffix(".0") + "%"


def interval(low: float, high: float) -> str:
    """``48.6–66%``."""
    return f"{percent(low).removesuffix('%')}–{percent(high)}"


def points(difference: float | None) -> str:
    """``+4.2``: a difference of two shares, in percentage points."""
    return "–" if difference is None else f"{100 * difference:+.1f}"


def count_of(count: int, of: int, low: float, high: float) -> str:
    """``3 of 10 (10.8–60.3%)``, without an interval where there are none."""
    return f"{count} of {of} ({interval(low, high)})" if of else f"{count} of {of}"


def duration(seconds: float) -> str:
    """``45 s``, ``12 min``, ``1.5 h``."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def size(number: int) -> str:
    """Bytes as ``48 kB`` or ``1.2 MB``."""
    return f"{number / 1e6:.1f} MB" if number >= 1e6 else f"{math.ceil(number / 1e3)} kB"


def ambiguous(a: str, b: str) -> bool:
    """Whether one spoken name contains all words of the other, as ``large plate`` and ``plate``."""
    words, others = set(a.lower().split()), set(b.lower().split())
    return words <= others or others <= words
