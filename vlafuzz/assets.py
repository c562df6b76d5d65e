"""Where files lie that we may not ship, such as robots and photos: in folders of the user's."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from vlafuzz.errors import PrerequisiteError

FOLDERS = "VLAFUZZ_PACKS"  # in the environment: folders, separated as in PATH


def add_folders(folders: Iterable[Path]) -> None:
    """Look here too, before the others: in this process and in those that it starts."""
    given = [str(folder.resolve()) for folder in folders]
    known = [folder for folder in _listed() if folder not in given]
    if given:
        os.environ[FOLDERS] = os.pathsep.join(given + known)


def find(path: str) -> Path | None:
    """The first that there is of a file or folder, such as ``robots/widowx/wx250s.urdf``."""
    places = (Path(folder) / path for folder in _listed())
    return next((place for place in places if place.exists()), None)


def need(path: str, what: str) -> Path:
    """As ``find``.

    Args:
        what: wants it, for the message.

    Raises:
        PrerequisiteError: it is in none of the folders.
    """
    found = find(path)
    if found is None:
        folders = ", ".join(_listed())
        raise PrerequisiteError(
            f"{what}: needs {path}, which {'is not in ' + folders if folders else 'no folder was named for'}",
            hint=f"name the folder that holds {path.split('/')[0]}/ in {FOLDERS}, or run with --pack",
        )
    return found


def _listed() -> list[str]:
    return [folder for folder in os.environ.get(FOLDERS, "").split(os.pathsep) if folder]
