"""Quantities: numbers of a scene through which several operators act, and how one is said to matter."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from vlafuzz.common.arrays import Array, Mask
from vlafuzz.model.scene import Real, Text


@dataclass(frozen=True)
class Quantity:
    """A number of a scene that no single operator has, but several change.

    Attributes:
        above: what is true of scenes with at least some amount, which is written ``{}``; ``below``: with at most that.
        unit: behind the amount.
        step: thresholds are multiples of it.
    """

    above: str
    below: str
    unit: str = ""
    step: float = 1.0

    def says(self, threshold: float, *, above: bool) -> str:
        """A clause: ``the target appears ≥ 11 px lower than usual``. The words tell the sign of the amount."""
        return (self.above if above else self.below).format(f"{abs(threshold):g}{self.unit}")


def plain_quantity(name: str) -> Quantity:
    """One of which no more than the name is known, such as one of a later version."""
    return Quantity(f"{name} ≥ {{}}", f"{name} ≤ {{}}")


@dataclass(frozen=True)
class Mechanism:
    """A quantity through which the operators of several causes act.

    Attributes:
        quantity: by its name in ``Space.quantities``.
        threshold: the policy fails from there on; ``above``: upwards, else downwards.
        ways: the operators that bring it about, each with its direction if it has one: ``camera-orientation -pitch``.
        swapped: shown by a swap: two operators were tried beyond the threshold, each without the other and repeatedly,
            and the policy mostly failed with either.
    """

    quantity: Text
    threshold: Real
    above: bool
    ways: Annotated[tuple[Text, ...], Field(min_length=1, max_length=100)]
    swapped: bool = False

    def holds(self, amounts: Array) -> Mask:
        """Whether amounts of the quantity are beyond the threshold; NaN is not."""
        return amounts >= self.threshold if self.above else amounts <= self.threshold
