"""``python:pkg.mod:factory``: the user's own policy or strategy, wherever a name is expected."""

import hashlib
import importlib
import os
import sys
import sysconfig
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vlafuzz.errors import PrerequisiteError, UsageError, VlafuzzError, suggestion

PREFIX = "python:"
OBJECT = "object:"  # begins the names of policies that were handed over as objects
EVERYTHING = "--trust"
_TRUSTED = "VLAFUZZ_TRUST"  # environment variable with one reference a line
_LIBRARIES = tuple(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib"))
_FORM = "expected python:package.module:factory"


def is_reference(name: str) -> bool:
    """Whether a name refers to the user's own code."""
    return name.startswith(PREFIX)


@contextmanager
def trusting(*references: str) -> Iterator[None]:
    """Accept these references where a file names them, in this process and in its children.

    Args:
        references: those that the user named, or ``EVERYTHING``.
    """
    before = os.environ.get(_TRUSTED, "")
    parts = (part.strip() for reference in references for part in [reference, *reference.split(",")])
    os.environ[_TRUSTED] = "\n".join([before, *parts])
    try:
        yield
    finally:
        os.environ[_TRUSTED] = before


def check_trusted(*names: str) -> None:
    """Check names, or lists of them with commas, that a file holds: one that somebody sent must not run code.

    Raises:
        UsageError: one refers to code, and the user neither named it nor said ``--trust``.
    """
    trusted = os.environ.get(_TRUSTED, "").split("\n")
    for name in (name.strip() for several in names for name in several.split(",")):
        if _loads_code(name) and not {name, EVERYTHING} & set(trusted):
            message = f"the file names {name!r}: code, which is not run just because a file names it"
            raise UsageError(message, hint="if you know that code, repeat the command with --trust")


def trust_flag(*names: str) -> list[str]:
    """The flag with which a command accepts these names from a file; empty where it needs none."""
    return [EVERYTHING] if any(map(_loads_code, names)) else []


def _loads_code(name: str) -> bool:
    return name.startswith((PREFIX, "lerobot:"))  # whose folder may name modules


def load_factory(reference: str) -> Callable[..., Any]:
    """The callable that a reference names. Modules in the current folder can be named, too.

    Raises:
        UsageError: the reference is malformed, or the module or the callable does not exist.
        PrerequisiteError: importing the module raises.
    """
    module_name, _, attribute = reference.removeprefix(PREFIX).partition(":")
    if not module_name or not attribute:
        raise UsageError(f"{reference!r} names no factory", hint=_FORM)
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    with users_code(reference):
        try:
            module = importlib.import_module(module_name)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{module_name}.".startswith(f"{error.name}."):
                raise  # the module exists, but something that it imports does not
            raise UsageError(f"{reference!r}: no module {error.name!r}", hint=_FORM) from None
    factory = getattr(module, attribute, None)
    if not callable(factory):
        public = [name for name, value in vars(module).items() if callable(value) and name[0] != "_"]
        raise UsageError(f"{reference!r}: no callable {attribute!r}", hint=suggestion(attribute, public))
    return factory  # type: ignore[no-any-return]


def make_of(reference: str) -> Any:
    """Call the factory that a reference names.

    Raises:
        UsageError: see ``load_factory``.
        PrerequisiteError: the user's code raises.
    """
    factory = load_factory(reference)
    with users_code(reference):
        return factory()


def source_digest(name: str, made: object) -> str:
    """Digest of the file of the user's code that made an object; empty for our own code and without a file.

    It distinguishes versions of the user's code, as far as that one file differs.
    """
    if is_reference(name):
        load_factory(name)
        module = name.removeprefix(PREFIX).partition(":")[0]
    elif name.startswith(OBJECT) and not type(made).__module__.startswith("vlafuzz."):
        module = type(made).__module__
    else:
        return ""
    file = getattr(sys.modules[module], "__file__", None)
    return hashlib.blake2b(Path(file).read_bytes(), digest_size=6).hexdigest() if file else ""


@contextmanager
def users_code(reference: str) -> Iterator[None]:
    """Report exceptions of the user's own code in one sentence, with the file and line.

    Raises:
        PrerequisiteError: the code in the block raised.
    """
    try:
        yield
    except VlafuzzError:
        raise
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if not frame.filename.startswith((*_LIBRARIES, "<frozen"))]
        last = (own or frames)[-1]
        hint = f"raised at {last.filename}:{last.lineno}: {last.line}"
        raise PrerequisiteError(f"{reference}: {type(error).__name__}: {error}", hint) from error
