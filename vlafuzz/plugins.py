"""``python:pkg.mod:factory``: a user's own subject or strategy, wherever a name is expected."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from typing import Any

from vlafuzz.errors import UsageError, suggestion

PREFIX = "python:"
_FORM = "expected python:package.module:factory"


def is_reference(name: str) -> bool:
    """Whether a name is such a reference."""
    return name.startswith(PREFIX)


def load_factory(reference: str) -> Callable[..., Any]:
    """The callable that a reference names. Modules of the current folder are found too.

    Raises:
        UsageError: not of that form, no such module, or no such callable in it.
    """
    module_name, _, attribute = reference.removeprefix(PREFIX).partition(":")
    if not module_name or not attribute:
        raise UsageError(f"{reference!r} names no factory", hint=_FORM)
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module_name}.".startswith(f"{error.name}."):
            raise  # the module is there, and something that it imports is not
        raise UsageError(f"{reference!r}: no module {error.name!r}", hint=_FORM) from None
    factory = getattr(module, attribute, None)
    if not callable(factory):
        public = [name for name, value in vars(module).items() if callable(value) and name[0] != "_"]
        raise UsageError(f"{reference!r}: no callable {attribute!r}", hint=suggestion(attribute, public))
    return factory  # type: ignore[no-any-return]
