"""``--config``: the flags of a command from a YAML file; those on the command line win."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from vlafuzz.errors import UsageError, suggestion

_NEVER = ("config", "trust", "help")  # a file does not say that it may be trusted
_HINT = "expected the flags of the command, one a line, such as budget: 300"


def _read(context: typer.Context, values: list[str] | None) -> list[str] | None:
    """Make what files and assignments say the defaults of the command that is parsed; the last one counts."""
    known = {name for one in context.command.params if (name := one.name) and name not in _NEVER}
    for value in values or ():
        name, sign, text = value.partition("=")
        inline = sign and not Path(value).is_file()
        said = _flags("--config", {name: text}, known) if inline else flags_in(Path(value), known)
        context.default_map = {**(context.default_map or {}), **said}
    return values


def flags_in(path: Path, known: set[str]) -> dict[str, Any]:
    """The values of flags in a file, by parameter; lists of a flag that takes one text have commas.

    Raises:
        UsageError: the file has no flags, others than the known ones, or names code that is not trusted.
    """
    from vlafuzz.common.reading import read_yaml

    content = read_yaml(path, UsageError, _HINT)
    if not isinstance(content, dict):
        raise UsageError(f"{path}: not a list of flags", hint=_HINT)
    return _flags(str(path), content, known)


def _flags(path: str, content: Mapping[Any, Any], known: set[str]) -> dict[str, Any]:
    from vlafuzz.common.plugins import check_trusted

    flags: dict[str, Any] = {}
    for key, value in content.items():
        name = str(key).removeprefix("--").replace("-", "_")
        name = "packs" if name == "pack" else name
        if name not in known:
            raise UsageError(f"{path}: {key!r} is no flag of this command", hint=suggestion(name, known))
        values = value if isinstance(value, list) else [value]
        if not values or not all(isinstance(one, (str, int, float, bool)) for one in values):
            raise UsageError(f"{path}: {key}: not a value of a flag: {value!r}", hint=_HINT)
        check_trusted(*(one for one in values if isinstance(one, str)))
        flags[name] = ",".join(map(str, values)) if isinstance(value, list) and name != "packs" else value
    return flags


ConfigFlag = Annotated[
    list[str] | None,
    typer.Option(
        "--config",
        callback=_read,
        is_eager=True,
        help="YAML file of options, such as budget: 300; or one of them, NAME=VALUE. May be repeated; what "
        "is given here otherwise wins.",
        show_default=False,
    ),
]
