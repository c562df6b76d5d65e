"""All errors that vlafuzz raises on purpose: one clear sentence with the value, and a hint.

The result of a scene is an outcome, never an exception: a crash of policy or simulator is the verdict ERROR.
"""

import difflib
import shlex
import sys
from collections.abc import Iterable
from importlib import metadata
from typing import Literal

Cause = Literal["connect", "timeout", "protocol", "remote", "bad_action"]
LONGEST = 300  # characters of a message
_SPACES = "\n\t\u00a0\u2009\u202f\u3000"  # which Python does not call printable


class VlafuzzError(Exception):
    """Base class. ``hint`` tells the user what to do."""

    exit_code = 2

    def __init__(self, message: str, hint: str | None = None) -> None:
        self.message = sentence(message)
        self.hint = None if hint is None else sentence(hint)
        super().__init__(self.message)

    def __reduce__(self) -> tuple[object, ...]:  # Exception's own loses the hint in pickling
        return (type(self), (self.message, self.hint))

    def __str__(self) -> str:
        return self.message


class UsageError(VlafuzzError):
    """A flag, name or file from the user is wrong: exit code 2."""


class CatalogueError(UsageError):
    """A catalogue of operators or objects is invalid; the message names file and key."""


class SceneError(UsageError):
    """A scene, or a file of scenes, cannot be read or built."""


class StoreError(UsageError):
    """A store cannot be opened, read or written, or lacks the requested runs or scenes."""


class CorpusError(UsageError):
    """An exported corpus cannot be read or written, or has nothing to replay."""


class PrerequisiteError(VlafuzzError):
    """Something must be installed, started or mended first; the hint names the command. Exit code 3."""

    exit_code = 3


class PolicyError(VlafuzzError):
    """The policy under test broke; this is no evidence about the scene. ``cause``: the kind of fault."""

    exit_code = 3

    def __init__(self, message: str, hint: str | None = None, cause: Cause = "remote") -> None:
        super().__init__(message, hint)
        self.cause = cause

    def __reduce__(self) -> tuple[object, ...]:
        return (type(self), (self.message, self.hint, self.cause))


class SimulatorError(VlafuzzError):
    """The simulator broke; this is no evidence about the policy."""

    exit_code = 3


def sentence(text: object) -> str:
    """A text from anywhere as one line of at most about 300 characters, which cannot steer a terminal."""
    line = printable(" ".join(str(text).split()))
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 92]} … {line[-89:]}"


def printable(text: str) -> str:
    """A text with its control characters escaped, but for line breaks and tabs."""
    if text.isprintable():
        return text
    return "".join(
        sign if sign.isprintable() or sign in _SPACES else sign.encode("unicode_escape").decode() for sign in text
    )


def check_probability(flag: str, value: float) -> None:
    """Raise a UsageError if the value of a flag is not above 0 and below 1."""
    if not 0 < value < 1:
        raise UsageError(f"{flag}: expected a probability above 0 and below 1, got {value:g}", hint=f"{flag} 0.05")


def check_number(flag: str, value: int | None, least: int, most: int | None = None) -> None:
    """Raise a UsageError if a flag's value is below ``least`` or above ``most``; None passes."""
    if value is not None and value < least:
        raise UsageError(f"{flag}: expected at least {least}, got {value}", hint=f"give {flag} {least} or more")
    if value is not None and most is not None and value > most:
        raise UsageError(f"{flag}: expected at most {most}, got {value}", hint=f"give {flag} {most} or less")


def install(extra: str) -> str:
    """The command that installs the packages of an extra by their names, since no index has vlafuzz."""
    try:
        declared = metadata.requires("vlafuzz") or []
    except metadata.PackageNotFoundError:  # a checkout that is not installed
        declared = []
    marked = [line.replace("'", '"').partition(";") for line in declared]
    packages = [name.strip() for name, _, marker in marked if f'extra == "{extra}"' in marker]
    return shlex.join([sys.executable, "-m", "pip", "install", *(packages or [f".[{extra}]"])])


def suggestion(name: str, known: Iterable[str]) -> str:
    """A hint for an unknown name: the most similar known one, or all of them."""
    known = sorted(known)
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return f"did you mean {near[0]!r}?" if near else "known: " + ", ".join(known)
