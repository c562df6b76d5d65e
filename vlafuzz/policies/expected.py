"""Values in a policy's spec that make sense: each is checked on construction."""

from reprlib import repr as shown
from typing import get_args

from vlafuzz.errors import UsageError


def expect(name: str, value: object, expected: str, *, usable: bool) -> None:
    """Raise a UsageError unless a value is usable."""
    if not usable:
        message = f"the policy's spec: {name}: expected {expected}, got {shown(value)}"
        raise UsageError(message, hint="vlafuzz.policies.base describes ActionSpec and PolicySpec")


def expect_one_of(name: str, value: object, literal: object) -> None:
    """Raise a UsageError unless a value is one of those of a ``Literal``."""
    known = get_args(literal)
    usable = isinstance(value, str) and value in known
    expect(name, value, f"one of {', '.join(known)}", usable=usable)


def expect_count(name: str, value: object, least: int, most: int | None = None) -> None:
    """Raise a UsageError unless a value is an integer from ``least`` to ``most``."""
    within = isinstance(value, int) and least <= value <= (value if most is None else most)
    expect(name, value, f"{least} or more" if most is None else f"{least} to {most}", usable=within)
