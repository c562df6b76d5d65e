"""``python:pkg.mod:factory``: the user's own policy or strategy, wherever a name is expected."""

import hashlib
import importlib
import os
import shlex
import sys
import sysconfig
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from ipaddress import ip_address
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from vlafuzz.errors import PrerequisiteError, UsageError, VlafuzzError, sentence, suggestion

PREFIX = "python:"
OBJECT = "object:"  # begins the names of policies that were handed over as objects
EVERYTHING = "--trust"
_ADDRESS = "://"  # in the names of policies behind servers
_TRUSTED = "VLAFUZZ_TRUST"  # environment variable with one reference a line
_LIBRARIES = tuple(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib"))
_FORM = "expected python:package.module:factory"


def is_reference(name: str) -> bool:
    """Whether a name refers to the user's own code."""
    return name.startswith(PREFIX)


def trust(*names: str) -> None:
    """Accept policies and strategies that the user named, or ``EVERYTHING``, until ``trusting`` ends."""
    kept = [name for name in names if name == "".join(name.splitlines())]  # one a line, and no other
    os.environ[_TRUSTED] = "\n".join([os.environ.get(_TRUSTED, ""), *kept])


@contextmanager
def trusting(*names: str) -> Iterator[None]:
    """``trust`` in a block, in this process and in its children; all trust of the block ends with it."""
    before = os.environ.get(_TRUSTED, "")
    trust(*names)
    try:
        yield
    finally:
        os.environ[_TRUSTED] = before


def check_trusted(*names: str) -> None:
    """Check names, or lists of them with commas, that a file holds: somebody may have sent it.

    UsageError if one is of code or of a server elsewhere, and the user neither named it nor said ``--trust``; what is
    asked on this machine is said on stderr, once.
    """
    for name in names:
        trusted = os.environ.get(_TRUSTED, "").split("\n")
        if {name, EVERYTHING} & {*trusted}:
            continue
        for part in (name, *(part.strip() for part in name.split(","))):
            if part not in trusted and (risk := _risk(part)):
                message = f"the file names {part!r}: {risk} just because a file names it"
                raise UsageError(message, hint="if you know and trust it, repeat the command with --trust")
        if _ADDRESS in name:
            sys.stderr.write(f"note: asks {sentence(name)}, which the file names\n")
            trust(name)


def command(*words: object, names: Iterable[str] = ()) -> str:
    """A command of vlafuzz to be copied, with the flag that it takes for these names from a file."""
    flag = [EVERYTHING] if any(map(_risk, names)) else []
    return shlex.join(["vlafuzz", *map(str, words), *flag])


def _risk(name: str) -> str | None:
    """Why a name from a file needs trust; None if it needs none."""
    if name.startswith((PREFIX, "lerobot:")):  # whose folder may name modules
        return "code, which is not run"
    address = "".join(filter(str.isprintable, name)).partition(_ADDRESS)  # as urlsplit, which drops tabs
    return "a server elsewhere, which is not asked" if address[1] and not _is_here(address[2]) else None


def _is_here(address: str) -> bool:
    """Whether an address without its scheme is on this machine."""
    try:
        host = urlsplit(f"//{address}").hostname or ""
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def load_factory(reference: str) -> Callable[..., Any]:
    """The callable that a reference names, perhaps in a module of the current folder.

    UsageError if there is none; PrerequisiteError if importing the module raises.
    """
    module_name, _, attribute = reference.removeprefix(PREFIX).partition(":")
    if not module_name or not attribute:
        raise UsageError(f"{reference!r} names no factory", hint=_FORM)
    if os.path.lexists(reference):
        message = f"{reference!r} is the name of a file here, which a pattern such as * may have put in"
        raise UsageError(message, hint="rename that file")
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
    """Call the factory that a reference names; PrerequisiteError if the user's code raises."""
    factory = load_factory(reference)
    with users_code(reference):
        return factory()


def source_digest(name: str, made: object) -> str:
    """Digest of the file of the user's code that made an object; empty for our own, and without a file."""
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
    """Report exceptions of the user's own code as a PrerequisiteError, with the file and line."""
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
