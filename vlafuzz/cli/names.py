"""Names on the command line: which code and servers the user named and so trusts, and what had another name before."""

from collections.abc import Mapping, Sequence
from typing import Any

import typer

from vlafuzz.common.plugins import EVERYTHING
from vlafuzz.errors import UsageError

# Commands and options that had another name before, with today's.
COMMANDS: Mapping[str, str] = {
    "subjects": "list policies",
    "policies": "list policies",
    "strategies": "list strategies",
    "operators": "list operators",
    "objects": "list objects",
    "import": "export FILE.json --out F.jsonl",
    "merge": "export A.db B.db --format store --out F.db",
    "findings": "report STORE",
    "watch": "report STORE --follow",
    "study": "lab study",
    "coverage": "lab coverage",
}
_CLUSTER = {"--address": "--executor ray:ADDRESS"}
OPTIONS: Mapping[str, Mapping[str, str]] = {
    "run": _CLUSTER
    | {
        "--table": "`vlafuzz report STORE --out rates.csv`",
        "--batch": "--config batch=8",
        "--criteria": "--config criteria=published",
        "--fail-on-finding": "--config fail-on-finding=true",
        "--pool": "--config pool=FILE",
        "--quality": "--config quality=fast",
        "--repeats": "--config repeats=3",
        "--stop-early": "--config stop-early=true",
        "--triage": "`vlafuzz triage STORE` after the run",
    },
    "lab": {"--alpha": "the `spread` of the light in --operators FILE", "--from": "`vlafuzz report STORE`"},
    "compare": _CLUSTER | dict.fromkeys(("--csv", "--markdown"), "--json"),
}


def check_names(words: Sequence[str]) -> None:
    """Raise a UsageError that gives the new name of a command or option, if the words have an old one."""
    command = words[0] if words else ""
    if command in COMMANDS:
        raise UsageError(f"`vlafuzz {command}` is `vlafuzz {COMMANDS[command]}` now")
    old = {"--subject": "--policy NAME", **OPTIONS.get(command, {})}
    for word in words:
        if (flag := word.partition("=")[0]) in old:
            raise UsageError(f"{flag}: this is {old[flag]} now")


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
