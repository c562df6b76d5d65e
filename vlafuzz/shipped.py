"""Locates the data that comes with vlafuzz, and the user's cache for data that is built once."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

from platformdirs import user_cache_path

_PACKAGE = Path(str(files("vlafuzz")))


def _folder(name: str) -> Path:
    """A data folder: inside the package in a wheel, beside it in a checkout."""
    packed = _PACKAGE / "_shipped" / name
    return packed if packed.is_dir() else _PACKAGE.parent / name


def operators_dir() -> Path:
    """The folder of operator ranges, instruction templates and object catalogues."""
    return _folder("operators")


def corpus_dir() -> Path:
    """The folder of shipped corpora."""
    return _folder("corpus")


def published_dir() -> Path:
    """The folder with the VLATest paper's findings."""
    return _folder("published")


def cache_dir() -> Path:
    """The cache folder: ``$VLAFUZZ_CACHE``, or the platform's default such as ``~/.cache/vlafuzz``."""
    return Path(os.environ.get("VLAFUZZ_CACHE") or user_cache_path("vlafuzz", appauthor=False))


def made_once(name: str, fill: Callable[[Path], None], is_complete: Callable[[Path], bool]) -> Path:
    """A folder of the cache, which is created by ``fill`` unless it exists and ``is_complete``.

    The folder appears complete or not at all, also when several processes create it at the same time.
    """
    folder = cache_dir() / name
    if is_complete(folder):
        return folder
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".", dir=folder.parent, ignore_cleanup_errors=True) as space:
        draft = Path(space) / "draft"
        draft.mkdir()
        fill(draft)
        try:
            draft.rename(folder)
        except OSError:
            if not is_complete(folder):  # damaged; otherwise another process was faster
                shutil.rmtree(folder, ignore_errors=True)
                draft.rename(folder)
    return folder
