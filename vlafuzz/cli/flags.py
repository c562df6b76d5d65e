"""Flags that several commands have, and ``--config``, by which a YAML file gives them."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from vlafuzz.campaign.options import AUTO, OPTIONS, RunConfig, severity_of_flag
from vlafuzz.cli.output import Bar
from vlafuzz.errors import UsageError, suggestion

_CONFIG_HINT = "expected the flags of the command, one a line, such as budget: 300"


def listed(names: str | None) -> tuple[str, ...] | None:
    """Names that are separated by commas; None where no flag is given."""
    return None if names is None else tuple(name.strip() for name in names.split(","))


def refuse(flags: Mapping[str, object], reason: str) -> None:
    """Raise a UsageError for the first of these flags that is given: it would have no effect."""
    for flag, value in flags.items():
        if value is not None:
            said = "" if isinstance(value, (bool, list)) else f" {value}"
            raise UsageError(f"{flag}{said}: {reason}", hint="leave it out")


def option(text: str, shown: str = "", *, flag: str = "", hidden: bool = False, panel: str | None = None) -> Any:
    """An option of a command.

    Args:
        shown: the default in words, where None stands for it.
        flag: its name, or several with spaces, if not that of the parameter; switches need one.
        panel: the group in which the page of help shows it.
    """
    return typer.Option(*flag.split(), help=text, show_default=shown or True, hidden=hidden, rich_help_panel=panel)


def option_of(name: str, shown: str | None = None, *, more: str = "", panel: str | None = None) -> Any:
    """An option that ``RunConfig`` declares; hidden if only ``--config`` has it.

    Args:
        shown: the default in words, if it is another one in this command; empty to show the value.
        more: what this command says about it, beside what holds for every command.
        panel: the group in which the page of help shows it.
    """
    told = OPTIONS[name]
    flag, default = told.flag or f"--{name.replace('_', '-')}", told.shown if shown is None else shown
    text = " ".join(filter(None, (told.help, more)))
    return option(text, default, flag=flag, hidden=not told.flag, panel=panel)


Command = Callable[..., None]


def with_run_options(*names: str, **shown: str) -> Callable[[Command], Command]:
    """Gives a command options of a ``RunConfig``, by default all, which it gets in its keywords.

    Args:
        shown: defaults in words, by the option's name, where they are other ones in this command.
    """
    hints = get_type_hints(RunConfig)

    def made(name: str) -> Parameter:
        told = OPTIONS[name]
        given = option_of(name, shown.get(name), more="" if names else told.of_run, panel=told.panel)
        return Parameter(
            name, Parameter.KEYWORD_ONLY, default=None, annotation=Annotated[(told.kind or hints[name]) | None, given]
        )

    def decorated(command: Command) -> Command:
        whole = signature(command, eval_str=True)
        own = [one for one in whole.parameters.values() if one.kind is not Parameter.VAR_KEYWORD]
        command.__signature__ = whole.replace(  # type: ignore[attr-defined] # typer reads it
            parameters=[*map(made, names or OPTIONS), *(one.replace(kind=Parameter.KEYWORD_ONLY) for one in own)]
        )
        return command

    return decorated


def configured(given: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a ``RunConfig`` that the options say, without those that nobody gives."""
    read: dict[str, Callable[[Any], Any]] = {
        "vary": listed,
        "packs": lambda folders: opened(folders) or None,
        "severity": lambda said: said if said in (None, AUTO) else severity_of_flag(said),
    }
    values = {name: read[name](value) if name in read else value for name, value in given.items()}
    return {name: value for name, value in values.items() if value is not None}


def typed() -> str:
    """The command line as the user typed it."""
    return shlex.join(["vlafuzz", *sys.argv[1:]])


def opened(folders: Sequence[str] | None) -> tuple[Any, ...]:
    """The packs in these folders; errors as of ``World.open_packs``."""
    if not folders:
        return ()
    from vlafuzz.worlds import usual_world

    with Bar() as bar:
        return usual_world().open_packs(folders, bar)


def _read_config(context: typer.Context, values: list[str] | None) -> list[str] | None:
    """Make what files and assignments say the defaults of the command that is parsed; the last one counts.

    Raises:
        UsageError: a file has no flags, others than the command's, or names code that is not trusted.
    """
    from vlafuzz.common.reading import read_yaml

    never = ("config", "trust", "help")  # a file does not say that it may be trusted
    known = {name for one in context.command.params if (name := one.name) and name not in never}
    for value in values or ():
        name, sign, text = value.partition("=")
        if sign and not Path(value).is_file():
            said = _flags("--config", {name: text}, known)
        else:
            content = read_yaml(Path(value), UsageError, _CONFIG_HINT)
            if not isinstance(content, dict):
                raise UsageError(f"{value}: not a list of flags", hint=_CONFIG_HINT)
            said = _flags(value, content, known)
        context.default_map = {**(context.default_map or {}), **said}
    return values


def _flags(path: str, content: Mapping[Any, Any], known: set[str]) -> dict[str, Any]:
    """The values of flags by parameter; lists of a flag that takes one text get commas."""
    from vlafuzz.common.plugins import check_trusted

    flags: dict[str, Any] = {}
    for key, value in content.items():
        name = str(key).removeprefix("--").replace("-", "_")
        name = "packs" if name == "pack" else name
        if name not in known:
            raise UsageError(f"{path}: {key!r} is no flag of this command", hint=suggestion(name, known))
        values = value if isinstance(value, list) else [value]
        if not values or not all(isinstance(one, (str, int, float, bool)) for one in values):
            raise UsageError(f"{path}: {key}: not a value of a flag: {value!r}", hint=_CONFIG_HINT)
        check_trusted(*(one for one in values if isinstance(one, str)))
        flags[name] = ",".join(map(str, values)) if isinstance(value, list) and name != "packs" else value
    return flags


RobotFlag = Annotated[str | None, option_of("robot")]
LabelFlag = Annotated[str | None, option_of("label")]
OperatorsFlag = Annotated[str | None, option_of("operators")]
WorkersFlag = Annotated[int | None, option_of("workers")]
ExecutorFlag = Annotated[str | None, option_of("executor")]
PackFlag = Annotated[list[str] | None, option_of("packs")]
VideosFlag = Annotated[
    bool, option("Film what passes, what fails and what solves it, on a page.", flag="--videos/--no-videos")
]
AlphaFlag = Annotated[float, option("Probability of a false alarm, at most.")]
TimeFlag = Annotated[
    str | None, option("Wall clock that it takes at most: 1h, 30m, 90s, 1h30m.", "no limit", flag="--time")
]
JsonFlag = Annotated[bool, option("Print JSON.", flag="--json")]
TrustFlag = Annotated[
    bool, option("Load code (python:…) and ask servers that the file names, not only yours.", flag="--trust")
]
ConfigFlag = Annotated[
    list[str] | None,
    typer.Option(
        "--config",
        callback=_read_config,
        is_eager=True,
        help="YAML file of options, such as budget: 300; or one of them, NAME=VALUE. May be repeated; what is given "
        "here otherwise wins.",
        show_default=False,
    ),
]
