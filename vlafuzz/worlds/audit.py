"""The audit of a suite's own initial states: what is wrong with them before any policy acts."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

# By name: what a defect of an initial state means.
CHECKS = {
    "setup": "the suite's own package cannot build the task: a file is missing, or a thing is named twice",
    "overlaps": "two things begin inside each other, by more than 5 mm",
    "slides": "something moves sideways by more than 1 cm while the robot keeps still",
    "falls": "something topples by more than 20° or falls down while the robot keeps still",
    "moving": "something still moves by more than 5 mm after the settling steps, before a policy's eyes",
    "solved": "the goal holds before the robot moves",
    "premise": "what problem or instruction says of the start is not true",
}


@dataclass(frozen=True)
class Defect:
    """A defect of initial state ``state``; ``amount`` in the unit that ``reason`` says."""

    state: int
    check: str
    reason: str
    amount: float

    @property
    def kind(self) -> tuple[str, str]:
        """What is wrong with what, without the amount."""
        return self.check, self.reason.split(" by ")[0]


@dataclass(frozen=True)
class AuditedTask:
    """The verdict on a task's first ``states`` initial states."""

    name: str
    instruction: str
    states: int
    defects: tuple[Defect, ...]

    def count(self, check: str) -> int:
        """The number of states with a defect of this kind."""
        return len({defect.state for defect in self.defects if defect.check == check})

    @property
    def sound(self) -> int:
        """The number of states without any defect."""
        return len(set(range(self.states)) - {defect.state for defect in self.defects})

    def kinds(self) -> list[tuple[Defect, int]]:
        """Defects that differ by more than state and amount, worst example and number of states each."""
        counts = Counter(defect.kind for defect in self.defects)
        worst: dict[tuple[str, str], Defect] = {}
        for defect in sorted(self.defects, key=lambda defect: defect.amount):
            worst[defect.kind] = defect
        order = list(CHECKS)
        pairs = [(worst[kind], counts[kind]) for kind in worst]
        return sorted(pairs, key=lambda pair: (order.index(pair[0].check), -pair[1]))


@dataclass(frozen=True)
class AuditedSuite:
    """The verdicts on a suite, and ``surroundings``: the versions that they hold for."""

    suite: str
    surroundings: str
    tasks: tuple[AuditedTask, ...]
