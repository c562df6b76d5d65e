"""Flags that several commands have."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from vlafuzz.campaign.options import OPTIONS, RunConfig
from vlafuzz.cli.output import Bar


class Frame(StrEnum):
    """How VLATest's table frame is mapped to ours."""

    FIT = "fit"
    KEEP = "keep"
    ORIGINAL = "original"
    ROBOT = "robot"


def listed(names: str | None) -> tuple[str, ...] | None:
    """Names that are separated by commas; None where no flag is given."""
    return None if names is None else tuple(name.strip() for name in names.split(","))


def option(text: str, shown: str = "", *, flag: str = "", hidden: bool = False) -> Any:
    """An option of a command.

    Args:
        shown: the default in words, where None stands for it.
        flag: its name, or several with spaces, if not that of the parameter; switches need one.
    """
    return typer.Option(*flag.split(), help=text, show_default=shown or True, hidden=hidden)


def label_option(flag: str, text: str, default: str = "") -> Any:
    """An option that takes a label, and refuses what does not fit into a line of text."""

    def checked(label: str | None) -> str | None:
        from vlafuzz.model.label import check_label

        check_label(flag, label)
        return label

    return typer.Option(flag, help=text, show_default=default or False, callback=checked)


def option_of(name: str) -> Any:
    """The option of a run's configuration; hidden if only ``--config`` has it."""
    told = OPTIONS[name]
    flag = told.flag or f"--{name.replace('_', '-')}"
    if name == "label":
        return label_option(flag, told.help, told.shown)
    return option(told.help, told.shown, flag=flag, hidden=not told.flag)


def with_run_options(command: Callable[..., None]) -> Callable[..., None]:
    """The same command with all options of a ``RunConfig``, which it gets in its keywords."""
    hints = get_type_hints(RunConfig)
    options = [
        Parameter(
            name,
            Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[(told.kind or hints[name]) | None, option_of(name)],
        )
        for name, told in OPTIONS.items()
    ]
    whole = signature(command, eval_str=True)
    own = [one for one in whole.parameters.values() if one.kind is not Parameter.VAR_KEYWORD]
    command.__signature__ = whole.replace(  # type: ignore[attr-defined] # typer reads it
        parameters=[*options, *(one.replace(kind=Parameter.KEYWORD_ONLY) for one in own)]
    )
    return command


def configured(given: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of a ``RunConfig`` that the options say, without those that nobody gives."""
    read: dict[str, Callable[[Any], Any]] = {"vary": listed, "packs": lambda folders: opened(folders) or None}
    values = {name: read[name](value) if name in read else value for name, value in given.items()}
    return {name: value for name, value in values.items() if value is not None}


RobotFlag = Annotated[str | None, option_of("robot")]
PolicyFlag = Annotated[str | None, option_of("policy")]
LabelFlag = Annotated[str | None, option_of("label")]
OperatorsFlag = Annotated[str | None, option_of("operators")]
VaryFlag = Annotated[str | None, option_of("vary")]
WorkersFlag = Annotated[int | None, option_of("workers")]
ExecutorFlag = Annotated[str | None, option_of("executor")]
PackFlag = Annotated[list[str] | None, option_of("packs")]
ServedFlag = Annotated[
    str | None, label_option("--label", "Of models that are served at one address in turn, the one that answers now.")
]
AlphaFlag = Annotated[float, typer.Option(help="Probability of a false alarm, at most.")]
AnswersFlag = Annotated[
    Path | None, option("Keep outcomes by model in this file, and reuse those in it.", flag="--answers")
]
PlacementFlag = Annotated[str | None, option(OPTIONS["placement"].help, OPTIONS["placement"].shown, flag="--placement")]
TimeFlag = Annotated[
    str | None, option("Wall clock that it takes at most: 1h, 30m, 90s, 1h30m.", "no limit", flag="--time")
]
JsonFlag = Annotated[bool, option("Print JSON.", flag="--json")]
CsvFlag = Annotated[bool, option("Print CSV.", flag="--csv")]
MarkdownFlag = Annotated[bool, option("Print Markdown.", flag="--markdown")]
TrustFlag = Annotated[
    bool, option("Load code (python:…) and ask servers that the file names, not only yours.", flag="--trust")
]


def opened(folders: Sequence[str] | None) -> tuple[Any, ...]:
    """The packs in these folders; notes say what is missing in them.

    Raises:
        UsageError: a folder is no pack and has none in it.
        CatalogueError: a mesh is damaged.
    """
    if not folders:
        return ()
    # Imported late: `vlafuzz doctor` has to start anywhere.
    from vlafuzz.worlds import world_with
    from vlafuzz.worlds.capabilities import Catalogued

    with Bar() as bar:
        return world_with(Catalogued).open_packs(folders, bar)
