"""Capabilities that a world may have besides its tasks; ``world_with`` finds a world with one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

from vlafuzz.common.watch import Watch
from vlafuzz.model.scene import Scene

Frame = Literal["fit", "keep", "original", "robot"]
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


@runtime_checkable
class Audited(Protocol):
    """A world with suites of its own initial states, which can be audited."""

    def audit(self, suite: str, states: int | None, watch: Watch) -> AuditedSuite:
        """What is wrong with a suite's first ``states`` initial states of each task before any policy acts.

        Raises:
            UsageError: there is no such suite.
            PrerequisiteError: the world's packages are not installed.
        """


@dataclass(frozen=True)
class Drawing:
    """Whether pictures can be drawn: ``name`` says by what, or why not; ``follows`` what that means."""

    name: str
    works: bool
    follows: str = ""


@runtime_checkable
class Equipped(Protocol):
    """A world that needs packages and drivers, which ``vlafuzz doctor`` checks."""

    def packages(self) -> Mapping[str, str]:
        """The packages by name, with what follows where one cannot be imported."""

    def try_drawing(self) -> Drawing:
        """The result of drawing a picture in a new process."""


@dataclass(frozen=True, kw_only=True)
class ListedObject:
    """An object of a catalogue.

    Attributes:
        size: sides of the bounding box, metres.
        mass: kilograms.
        poses: its rest poses, each with the narrowest grasp in it, metres; None without one.
    """

    name: str
    spoken: str
    role: str
    size: tuple[float, ...]
    mass: float
    poses: Mapping[str, float | None]


@dataclass(frozen=True, kw_only=True)
class ListedOperators:
    """The operators of a file as rows; ``differing`` names the tasks that have ranges of their own."""

    title: str
    rows: Sequence[Mapping[str, Any]]
    differing: Sequence[str]


@runtime_checkable
class Catalogued(Protocol):
    """A world with a catalogue of objects, to which packs of the user's add others."""

    def open_packs(self, folders: Sequence[str], watch: Watch) -> tuple[Any, ...]:
        """The packs in these folders, measured; notes say what is missing in them.

        Raises:
            UsageError: a folder is no pack and has none in it.
            CatalogueError: a mesh is damaged.
        """

    def listed_objects(self, packs: Sequence[Any]) -> list[ListedObject]:
        """The objects of the catalogue, or of packs."""

    def listed_operators(
        self, source: str | None, task: str | None, robot: str | None, packs: Sequence[Any]
    ) -> ListedOperators:
        """The operators of a file; a CatalogueError or UsageError where a run would refuse it."""


@dataclass(frozen=True)
class Imported:
    """The scenes of a file in another format.

    Attributes:
        read: number of scenes in the file.
        numbers: of the imported scenes in the file.
        missing: names without a counterpart of ours, with the number of scenes that have them.
    """

    path: Path
    read: int
    numbers: tuple[int, ...]
    scenes: tuple[Scene, ...]
    missing: dict[str, int]

    @property
    def left_out(self) -> int:
        """Number of scenes with an object that has no counterpart."""
        return self.read - len(self.scenes)


@dataclass(frozen=True)
class Problem:
    """A problem in a line of a file of scenes; ``check`` is the check that the line fails, or ``broken``."""

    line: int
    check: str
    reason: str


@dataclass(frozen=True)
class FileVerdicts:
    """The verdicts on the scenes of a file; ``counts`` of scenes by what ``SceneFormats.lint_means`` explains."""

    path: Path
    counts: Mapping[str, int]
    problems: Sequence[Problem]


@runtime_checkable
class SceneFormats(Protocol):
    """A world that reads scene files of another program."""

    def import_scenes(self, path: Path, frame: Frame) -> Imported:
        """The scenes of a file in the other format; a SceneError if it is none."""

    @property
    def lint_means(self) -> Mapping[str, str]:
        """What ``lint`` counts, by the keys of the counts."""

    @property
    def visibility(self) -> str:
        """The bounds within which a target counts as visible."""

    def lint(self, path: Path, frame: Frame, packs: Sequence[Any], watch: Watch, *, settle: bool) -> FileVerdicts:
        """Check all scenes of a file, with objects of the catalogue and of packs; with ``settle`` also simulated."""
