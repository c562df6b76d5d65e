"""``--config``: the flags of a command from a YAML file; those on the command line win."""

from pathlib import Path
from typing import Annotated, Any

import typer

from vlafuzz.errors import UsageError, suggestion

_NEVER = ("config", "trust", "help")  # a file does not say that it may be trusted
_HINT = "expected the flags of the command, one a line, such as budget: 300"


def _read(context: typer.Context, path: Path | None) -> Path | None:
    """Make the flags in a file the defaults of the command that is parsed."""
    if path is not None:
        known = {name for one in context.command.params if (name := one.name) and name not in _NEVER}
        context.default_map = {**(context.default_map or {}), **flags_in(path, known)}
    return path


def flags_in(path: Path, known: set[str]) -> dict[str, Any]:
    """The values of flags in a file, by parameter; lists of a flag that takes one text have commas.

    Raises:
        UsageError: the file has no flags, others than the known ones, or names code that is not trusted.
    """
    from vlafuzz.common.plugins import check_trusted
    from vlafuzz.common.reading import read_yaml

    content = read_yaml(path, UsageError, _HINT)
    if not isinstance(content, dict):
        raise UsageError(f"{path}: not a list of flags", hint=_HINT)
    flags: dict[str, Any] = {}
    for key, value in content.items():
        name = str(key).removeprefix("--").replace("-", "_")
        if name not in known:
            raise UsageError(f"{path}: {key!r} is no flag of this command", hint=suggestion(name, known))
        values = value if isinstance(value, list) else [value]
        if not values or not all(isinstance(one, (str, int, float, bool)) for one in values):
            raise UsageError(f"{path}: {key}: not a value of a flag: {value!r}", hint=_HINT)
        check_trusted(*(one for one in values if isinstance(one, str)))
        flags[name] = ",".join(map(str, values)) if isinstance(value, list) and name != "pack" else value
    return flags


ConfigFlag = Annotated[
    Path | None,
    typer.Option(
        "--config",
        callback=_read,
        is_eager=True,
        help="YAML file of flags, such as budget: 300; those given here win.",
        show_default=False,
    ),
]
