"""Which kind of scene file a path is: our JSON lines, a file of VLATest, or a store."""

from __future__ import annotations

import json
from pathlib import Path

from vlafuzz.formats.scene_lines import SceneFile, read_scenes
from vlafuzz.formats.vlatest.read import Frame, read_vlatest
from vlafuzz.objects.catalogue import Catalogue


def is_store(path: Path) -> bool:
    """Whether a file is an SQLite database."""
    try:
        with path.open("rb") as stream:
            return stream.read(16) == b"SQLite format 3\0"
    except OSError:
        return False  # reading it will raise the error


def read_scene_file(path: Path, catalogue: Catalogue, frame: Frame) -> SceneFile:
    """Read a file of scenes, ours or VLATest's.

    Args:
        frame: of scenes of VLATest, see ``read_vlatest``.

    Raises:
        SceneError: the file cannot be read, or is a malformed file of VLATest.
    """
    if not is_vlatest(path):
        return SceneFile(path, tuple(read_scenes(path)))
    imported = read_vlatest(path, catalogue, frame=frame)
    return SceneFile(path, tuple(zip(imported.numbers, imported.scenes, strict=True)), imported.left_out)


def is_vlatest(path: Path) -> bool:
    """Whether a file is a single JSON document that is not one of our scenes."""
    if path.suffix != ".json":
        return False
    try:
        with path.open(encoding="utf-8") as stream:
            first = next((line for line in stream if line.strip()), "")
        document = json.loads(first)
    except (OSError, ValueError, RecursionError):  # undecodable, not JSON, nested too deeply
        return True  # reading it will raise the error
    return not (isinstance(document, dict) and "task" in document)
