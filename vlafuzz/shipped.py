"""Where the data that comes with vlafuzz lies: in a wheel beside the package, in a checkout at its top."""

from __future__ import annotations

import os
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


def cache_dir() -> Path:
    """The user's cache, for what is built once: ``$VLAFUZZ_CACHE``, or ``~/.cache/vlafuzz``."""
    named = os.environ.get("VLAFUZZ_CACHE")
    if named:
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "vlafuzz"
