"""Courses of runs in worlds with planted faults: the causes reported, when, and whether they are right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from strategies.faults import World
from strategies.faulty import SimulatedWorld
from strategies.search import Tried
from vlafuzz.model import Scene


@dataclass(frozen=True)
class Verdict:
    """A reported cause beside the truth.

    Attributes:
        faults: whose conditions its smallest failing scene meets.
        exact: there is one, and the operators are the fault's.
        unplanted: it meets none, but the policy fails there anyway: right or wrong, nobody knows.
    """

    faults: tuple[int, ...]
    exact: bool
    unplanted: bool = False

    @property
    def right(self) -> bool:
        return len(self.faults) == 1


@dataclass
class Course:
    """What a run has reported, and touched, by rollouts of the policy spent so far."""

    reports: list[tuple[int, tuple[Verdict, ...]]] = field(default_factory=list)
    touched: list[tuple[int, frozenset[int]]] = field(default_factory=list)

    def report(self, spent: int, verdicts: Sequence[Verdict]) -> None:
        """The causes that are reported from now on, in place of earlier ones."""
        if not self.reports or self.reports[-1][1] != tuple(verdicts):
            self.reports.append((spent, tuple(verdicts)))

    def figures(self, budget: int) -> dict[str, float]:
        """The counts after so many rollouts."""
        last = next((verdicts for spent, verdicts in reversed(self.reports) if spent <= budget), ())
        right = [verdict for verdict in last if verdict.right]
        touched = [faults for spent, faults in self.touched if spent <= budget]
        return {
            "identified": len(identified(last)),
            "exact": len({verdict.faults for verdict in last if verdict.exact}),
            "reported": sum(not verdict.unplanted for verdict in last),
            "unplanted": sum(verdict.unplanted for verdict in last),
            "right": len(right),
            "duplicates": len(right) - len(identified(last)),
            "rightly exact": sum(verdict.exact for verdict in last),
            "touched": len(frozenset().union(*touched)),
        }

    def times(self, budget: int) -> list[int]:
        """The rollouts after which one fault is identified, two are, and so on."""
        times: list[int] = []
        for spent, verdicts in self.reports:
            if spent <= budget:
                times += [spent] * (len(identified(verdicts)) - len(times))
        return times


def identified(verdicts: Sequence[Verdict]) -> set[int]:
    """The faults that at least one cause is about, and nothing but."""
    return {verdict.faults[0] for verdict in verdicts if verdict.right}


def judge(world: World, scene: Scene, operators: Sequence[str], unnamed: frozenset[str] = frozenset()) -> Verdict:
    """A reported cause beside the truth. ``unnamed``: operators that are never reported."""
    faults = tuple(world.met(scene))
    exact = len(faults) == 1 and frozenset(operators) == world.faults[faults[0]].operators - unnamed
    unplanted = not faults and isinstance(world, SimulatedWorld) and world.fails_anyway(scene)
    return Verdict(faults, exact, unplanted)


def touched(world: World, tried: Sequence[Tried]) -> frozenset[int]:
    """The faults whose conditions a failing scene meets."""
    return frozenset(fault for scene, judged in tried if judged.failed for fault in world.met(scene))
