"""Capabilities that a world may have besides its tasks; ``world_with`` finds a world with one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, runtime_checkable

from vlafuzz.common.watch import Watch
from vlafuzz.model.scene import Scene

Frame = Literal["fit", "keep", "original", "robot"]


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
