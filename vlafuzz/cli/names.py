"""Names on the command line: which code and servers the user named, and so trusts."""

from collections.abc import Sequence
from typing import Any

import typer

from vlafuzz.common.plugins import EVERYTHING


def named(command: Any, words: Sequence[str]) -> list[str]:
    """The policies and strategies that flags among the words behind a command name, and ``EVERYTHING`` for ``--trust``.

    A positional word is never among them, nor a value of ``--checkpoints``: a pattern such as ``*`` becomes names of
    files, which somebody else may have chosen.
    """
    given, *_ = command.make_parser(typer.Context(command)).parse_args(list(words))
    options = {param.name for param in command.params if param.param_type_name == "option"}
    found: list[str] = []
    for flag in ("policy", "policy_a", "policy_b", "baseline", "strategy", "strategies"):
        value = given.get(flag) if flag in options else None
        for name in [value] if isinstance(value, str) else value or ():
            found += [one.strip() for one in name.split(",")] if flag == "strategies" else [name]
    return [*found, *[EVERYTHING] * bool(given.get("trust"))]
