"""Finds files that may not be shipped, such as robots and photos, in the user's folders."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from vlafuzz.errors import PrerequisiteError

FOLDERS = "VLAFUZZ_PACKS"  # environment variable with a list of folders as in PATH


def add_folders(folders: Iterable[Path]) -> None:
    """Search these folders first, in this process and in its children."""
    added = [str(folder.resolve()) for folder in folders]
    if added:
        os.environ[FOLDERS] = os.pathsep.join(added + [folder for folder in listed() if folder not in added])


def listed() -> list[str]:
    """The user's folders."""
    return [folder for folder in os.environ.get(FOLDERS, "").split(os.pathsep) if folder]


def find(path: str) -> Path | None:
    """The first match of a relative path, such as ``robots/widowx/wx250s.urdf``; None without any."""
    places = (Path(folder) / path for folder in listed())
    return next((place for place in places if place.exists()), None)


def need(path: str, what: str) -> Path:
    """As ``find``.

    Args:
        what: what needs the file, for the message.

    Raises:
        PrerequisiteError: the file is in none of the folders.
    """
    place = find(path)
    if place is None:
        folders = ", ".join(listed())
        raise PrerequisiteError(
            f"{what}: needs {path}, which {'is not in ' + folders if folders else 'no folder was named for'}",
            hint=f"name the folder that holds {path.split('/')[0]}/ in {FOLDERS}, or run with --pack",
        )
    return place
