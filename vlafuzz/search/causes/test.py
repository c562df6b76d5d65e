"""Test: a scene that is rolled out to learn what makes a policy fail."""

from __future__ import annotations

from dataclasses import dataclass

from vlafuzz.search.causes.attribution import Attribution
from vlafuzz.search.causes.rules import Rule
from vlafuzz.search.causes.suspects import Mask
from vlafuzz.search.causes.units import Levels


@dataclass(frozen=True, eq=False)
class Test:
    """A scene with only some units kept: for an attribution, to try a rule on it, or for the background.

    Attributes:
        failure: whether the rule is to explain a failure; else its range is probed.
        chance: probability that the scene is in the range of the rule, so far.
        trial: number of rollouts for that, this one included.
        alone: it shows what a single unit does.
    """

    scene: Levels
    kept: Mask
    attribution: Attribution | None = None
    rule: Rule | None = None
    failure: bool = False
    chance: float = 0.5
    trial: int = 1
    alone: bool = False
