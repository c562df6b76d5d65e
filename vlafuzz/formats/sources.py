"""Files with scenes in them: our JSON lines, scene files of VLATest, stores."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from vlafuzz.errors import SceneError
from vlafuzz.formats.scene_lines import read_scenes
from vlafuzz.formats.vlatest.read import Frame, read_vlatest
from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.scene import Scene


@dataclass(frozen=True)
class Source:
    """What a file of scenes has.

    Attributes:
        lines: by the number of the line, or of the scene in a file of VLATest; a broken line is its error.
        left_out: scenes with an object that has no counterpart in our catalogue.
    """

    path: Path
    lines: tuple[tuple[int, Scene | SceneError], ...]
    left_out: int = 0

    def scenes(self) -> list[Scene]:
        """All of them.

        Raises:
            SceneError: a line is broken, or there is no scene.
        """
        for _, scene in self.lines:
            if isinstance(scene, SceneError):
                raise scene
        found = [scene for _, scene in self.lines if isinstance(scene, Scene)]
        if not found:
            raise SceneError(f"{self.path}: no scenes in it", hint="expected one JSON scene a line")
        return found


def is_store(path: Path) -> bool:
    """Whether a file is a database, which only stores are here."""
    try:
        with path.open("rb") as stream:
            return stream.read(16) == b"SQLite format 3\0"
    except OSError:
        return False  # who reads it says why


def read_source(path: Path, catalogue: Catalogue, frame: Frame) -> Source:
    """Read a file of scenes.

    Args:
        frame: how those of VLATest are read, see ``read_vlatest``.

    Raises:
        SceneError: it cannot be read, or is a damaged file of VLATest.
    """
    if not is_vlatest(path):
        return Source(path, tuple(read_scenes(path)))
    read = read_vlatest(path, catalogue, frame=frame)
    return Source(path, tuple(zip(read.numbers, read.scenes, strict=True)), read.left_out)


def is_vlatest(path: Path) -> bool:
    """Whether a file is one JSON object that is no scene of ours."""
    if path.suffix != ".json":
        return False
    try:
        with path.open(encoding="utf-8") as stream:
            first = next((line for line in stream if line.strip()), "")
        found = json.loads(first)
    except (OSError, ValueError, RecursionError):  # undecodable, no JSON, too deep
        return True  # who reads it says why
    return not (isinstance(found, dict) and "task" in found)
