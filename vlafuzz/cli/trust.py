"""Which code and servers the user named: values of flags for policies and strategies, and ``--trust``.

A positional word is never among them, nor a value of ``--checkpoints``: a pattern such as ``*`` becomes names of files,
which somebody else may have chosen.
"""

from collections.abc import Sequence
from typing import Any

import typer

from vlafuzz.common.plugins import EVERYTHING

_NAMES = ("policy", "policy_a", "policy_b", "baseline", "strategy")
_LISTS = ("strategies",)  # names that are separated by commas


def named(command: Any, words: Sequence[str]) -> list[str]:
    """The names in the words behind a command, which are parsed as the command does."""
    given, *_ = command.make_parser(typer.Context(command)).parse_args(list(words))
    options = {param.name for param in command.params if param.param_type_name == "option"}

    def values(*flags: str) -> list[str]:
        found = (given[flag] for flag in flags if flag in options and given.get(flag))
        return [name for value in found for name in ([value] if isinstance(value, str) else value)]

    listed = [name.strip() for names in values(*_LISTS) for name in names.split(",")]
    return [*values(*_NAMES), *listed, *[EVERYTHING] * bool(given.get("trust"))]
