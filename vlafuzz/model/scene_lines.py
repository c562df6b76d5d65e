"""Files of scenes: JSON lines, a scene a line."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from vlafuzz.common.files import write_whole
from vlafuzz.common.reading import MIB, parse_json, read_text
from vlafuzz.errors import SceneError, UsageError
from vlafuzz.model.scene import Scene

MOST, MOST_LINES = 256 * MIB, 200_000  # of a file: bytes; lines, of which each may be broken
_VERDICT = re.compile(r',"verdict":"[a-z]+"(?=}$)')  # beside scenes in files of earlier versions
_EXPECTED = "expected JSON lines with one scene per line"


def read_scenes(path: Path, inside: Path | None = None) -> Iterator[tuple[int, Scene | SceneError]]:
    """The scenes of a JSON-lines file with their line numbers, from 1; a broken line yields its error.

    ``inside``: see ``read_bytes``.
    """
    text = read_text(path, SceneError, _EXPECTED, most=MOST, inside=inside)
    lines = text.split("\n")  # U+2028 breaks no line
    if len(lines) > MOST_LINES:
        raise SceneError(f"{path}: has more than {MOST_LINES} lines", hint="split it into several files")
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            yield number, Scene.from_json(_VERDICT.sub("", line.rstrip()))
        except SceneError as error:
            yield number, SceneError(f"{path}:{number}: {error.message}", error.hint)


def load_scenes(path: Path | str, inside: Path | None = None) -> list[Scene]:
    """All scenes of a JSON-lines file; a SceneError if a line is broken, or there is no scene."""
    scenes: list[Scene] = []
    for _, scene in read_scenes(Path(path), inside):
        if isinstance(scene, SceneError):
            raise scene
        scenes.append(scene)
    if not scenes:
        raise SceneError(f"{path}: no scenes in it", hint=_EXPECTED)
    return scenes


def write_scenes(path: Path, scenes: Iterable[Scene]) -> None:
    """Write JSON lines atomically."""
    if path.is_dir():
        raise UsageError(f"{path}: is a folder", hint="name a file in it")
    write_whole(path, "".join(f"{scene.to_json()}\n" for scene in scenes))


def is_store(path: Path) -> bool:
    """Whether a file is an SQLite database."""
    try:
        with path.open("rb") as stream:
            return stream.read(16) == b"SQLite format 3\0"
    except OSError:
        return False  # reading it will raise the error


def is_document(path: Path) -> bool:
    """Whether a file is a single JSON document that is not one of our scenes."""
    if path.suffix != ".json":
        return False
    try:
        text = read_text(path, SceneError, most=MOST)
        document = parse_json(text.lstrip().partition("\n")[0])
    except (SceneError, ValueError):
        return True  # reading it will raise the error
    return not (isinstance(document, dict) and "task" in document)
