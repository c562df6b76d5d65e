"""Where the data that comes with vlafuzz lies: in a wheel beside the package, in a checkout at its top.

And where data lies that is made once, in the user's cache.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def _folder(name: str) -> Path:
    packed = _PACKAGE / "_shipped" / name
    return packed if packed.is_dir() else _PACKAGE.parent / name


def operators_dir() -> Path:
    """The folder of operator ranges, instruction templates and object catalogues."""
    return _folder("operators")


def corpus_dir() -> Path:
    """The folder of shipped corpora."""
    return _folder("corpus")


def published_dir() -> Path:
    """The folder of what the VLATest paper found."""
    return _folder("published")


def cache_dir() -> Path:
    """The user's cache, for what is built once: ``$VLAFUZZ_CACHE``, or ``~/.cache/vlafuzz``."""
    named = os.environ.get("VLAFUZZ_CACHE")
    if named:
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "vlafuzz"


def made_once(name: str, fill: Callable[[Path], None], whole: Callable[[Path], bool]) -> Path:
    """A folder of the user's cache, which ``fill`` makes unless it is there and ``whole``.

    It appears complete or not at all: processes may make the same at the same time.
    """
    folder = cache_dir() / name
    if whole(folder):
        return folder
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", dir=folder.parent, ignore_cleanup_errors=True) as space:
        draft = Path(space) / "draft"
        draft.mkdir()
        fill(draft)
        try:
            draft.rename(folder)
        except OSError:
            if not whole(folder):  # damaged; else another process was faster, with the same
                shutil.rmtree(folder, ignore_errors=True)
                draft.rename(folder)
    return folder
